"""Missions that a standing order started, as clients read them over HTTP."""

from threading import Thread
from typing import Any

from tests.http.conftest import Site
from tests.http.test_served_session import decision

ORDER = "Whenever a drone is below 20 %, relieve it."
LOW: dict[str, object] = {"kind": "battery", "asset": "Drone_T01", "percent": 15.0}


def test_a_mission_of_a_standing_order_is_listed_and_its_plan_is_shown(site: Site) -> None:
    order = site.waiting(ORDER)
    assert order["mission"]["source"] == "operator"
    assert site.ask("POST", "/v1/decisions", json=decision(order)).json()["accepted"]
    site.ended(order["mission"]["id"])
    passing = Thread(target=site.happens, args=(LOW, 5.0))
    passing.start()  # the clock of a program's own station stands while a plan waits
    plan = site.until("/v1/plans", lambda plans: next(iter(plans), None))
    assert plan["mission"]["source"] == "standing"
    listed = site.ask("GET", "/v1/missions", "observer").json()
    assert [one["source"] for one in listed] == ["operator", "standing"]
    whole = site.ask("GET", f"/v1/missions/{plan['mission']['id']}", "observer").json()
    assert whole["source"] == "standing"
    site.ask("POST", "/v1/decisions", json=decision(plan, "reject"))
    assert site.ended(plan["mission"]["id"])["status"] == "rejected"
    passing.join(60)


def test_a_timed_order_is_listed_with_its_next_moment_and_changed_over_http(site: Site) -> None:
    order = site.waiting("In one hour and then every ten minutes send Drone_T04 to the east gate.")
    assert site.ask("POST", "/v1/decisions", json=decision(order)).json()["accepted"]
    site.ended(order["mission"]["id"])
    site.happens(LOW, 1.0)
    one = listed(site)[-1]
    path = f"/v1/standing/{one['order']['id']}"
    assert (one["started"], one["paused"]) == (0, False)
    for change in ("pause", "skip", "resume"):
        assert site.ask("POST", f"{path}/{change}").status_code == 204
    again = listed(site)[-1]
    assert (again["paused"], again["next"] > one["next"]) == (False, True)
    assert site.ask("POST", f"{path}/revoke", "observer").status_code == 403
    assert site.ask("POST", f"{path}/revoke").status_code == 204
    assert one["order"]["id"] not in [each["order"]["id"] for each in listed(site)]
    assert site.ask("POST", f"{path}/pause").status_code == 404


def listed(site: Site) -> list[dict[str, Any]]:
    """Return the standing orders that are in force, as an observer reads them."""
    return site.ask("GET", "/v1/state", "observer").json()["standing"]
