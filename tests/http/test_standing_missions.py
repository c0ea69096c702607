"""Missions that a standing order started, as clients read them over HTTP."""

from threading import Thread

from tests.http.conftest import Site
from tests.http.test_served_session import decision

ORDER = "Whenever a drone is below 20 %, relieve it."
LOW = {"kind": "battery", "asset": "Drone_T01", "percent": 15.0}


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
