"""A session behind HTTP: who is let in, what may be done, and that nothing else decides."""

import json
import re
import socket
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import httpx
import pytest

import pa_console as pa
from pa_console.http.guard import MOST_BYTES
from pa_console.http.tokens import TOKENS_FILE, TokenBook
from pa_console.signing import key_path
from tests.http.conftest import FILL, WRITES_AT_ONCE, Site
from tests.scripted import ScriptedEngine

ORDER = "Fill the gap at EastGate."
PAGE = Path(pa.__file__).parent / "manual" / "serve.md"
[PROGRAM] = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
READS = ("whoami", "state", "rules", "missions", "plans")


def problem(answer: httpx.Response, code: int) -> dict[str, Any]:
    """Return the problem details of an answer, which have everything that they should."""
    assert answer.status_code == code, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert "Traceback" not in answer.text
    found = answer.json()
    assert set(found) == {"type", "title", "status", "detail", "field", "remedy"}
    return found


def decision(waiting: dict[str, Any], kind: str = "approve", **more: object) -> dict[str, Any]:
    """Return the body of a decision about what was shown."""
    request, shown = waiting["request"]["request_id"], waiting["shown_sha256"]
    return {"kind": kind, "request_id": request, "shown_sha256": shown, **more}


def test_a_mission_is_given_shown_approved_by_name_and_carried_out(site: Site) -> None:
    waiting = site.waiting(ORDER)
    assert waiting["request"]["plan"]["actions"] == [
        {"agent": "Drone_T04", "command": "move_to EastGate"}
    ]
    assert waiting["attempt"]["verdict"]["verdict"] == "Success"
    told = site.ask("POST", "/v1/decisions", json=decision(waiting))
    assert told.json() == {"accepted": True, "detail": "", "by": "anna"}
    ended = site.ended(waiting["mission"]["id"])
    assert ended["status"] == "verified"
    assert [made["decision"]["by"] for made in ended["decisions"]] == ["anna"]
    assert site.decided[-1].data.decision.by == "anna"  # type: ignore[union-attr]


def test_what_was_approved_is_exactly_what_was_shown(site: Site) -> None:
    waiting = site.waiting(ORDER)
    count = len(site.decided)
    body = decision(waiting)
    other = body | {"shown_sha256": "0" * 64}
    assert problem(site.ask("POST", "/v1/decisions", json=other), 409)["field"] == "shown_sha256"
    stale = body | {"request_id": "M001-0000.1"}
    found = problem(site.ask("POST", "/v1/decisions", json=stale), 409)
    assert found["type"].endswith("stale-plan")
    assert "/v1/plans" in found["remedy"]
    assert len(site.decided) == count
    assert site.ask("POST", "/v1/decisions", json=decision(waiting, "reject")).json()["accepted"]
    assert problem(site.ask("POST", "/v1/decisions", json=body), 409)["field"] == "request_id"
    assert site.ended(waiting["mission"]["id"])["status"] == "rejected"


def test_a_plan_that_the_rules_forbid_is_approved_by_nobody(site: Site) -> None:
    waiting = site.waiting(ORDER)
    strip = [{"agent": "Drone_T02", "command": "move_to EastGate"}]
    body = decision(waiting, "modify", actions=strip)
    assert site.ask("POST", "/v1/decisions", json=body).json()["accepted"]
    blocked = site.until(
        "/v1/plans", lambda plans: plans and plans[0]["request"]["blocked_by"] and plans[0]
    )
    assert "WF-03" in blocked["request"]["blocked_by"][0]
    refused = site.ask("POST", "/v1/decisions", "commander", json=decision(blocked))
    assert problem(refused, 409)["type"].endswith("not-admissible")
    site.ask("POST", "/v1/decisions", json=decision(blocked, "reject"))
    assert site.ended(waiting["mission"]["id"])["status"] == "refused"


def test_nobody_decides_in_another_name_or_beforehand(site: Site) -> None:
    body = {"kind": "approve", "request_id": "x", "shown_sha256": "0" * 64}
    for more in ({"by": "carl"}, {"signatures": {"carl": "x"}}, {"standing": True}):
        assert problem(site.ask("POST", "/v1/decisions", json=body | more), 422)["field"] in more


def test_an_alarm_is_acknowledged_by_name_and_one_that_is_not_open_by_nobody(site: Site) -> None:
    site.happens({"kind": "spawn", "gate": "WestGate", "distance_m": 60.0}, 5.0)
    alarm = site.until("/v1/state", lambda state: next(iter(state["alarms"]), None))
    assert alarm["acknowledged_by"] is None or not alarm["acknowledged_by"]
    path = f"/v1/alarms/{alarm['alarm']['id']}/acknowledge"
    assert site.ask("POST", path, "observer").status_code == 403
    assert site.ask("POST", path).status_code == 204
    seen = site.until(
        "/v1/state",
        lambda state: [one for one in state["alarms"] if one["acknowledged_by"]],
    )
    assert [one["acknowledged_by"] for one in seen] == ["anna"]
    missing = site.ask("POST", "/v1/alarms/A99/acknowledge")
    assert (missing.status_code, "'A99' is open" in missing.json()["detail"]) == (404, True)


def test_stop_works_for_an_operator_also_when_there_are_too_many_requests(site: Site) -> None:
    waiting = site.waiting(ORDER)
    answers = [site.ask("POST", "/v1/release", "bert") for _ in range(WRITES_AT_ONCE + 1)]
    assert {answer.status_code for answer in answers[:-1]} == {409}
    assert problem(answers[-1], 429)["remedy"].startswith("wait ")
    assert int(answers[-1].headers["retry-after"]) > 0
    assert site.ask("POST", "/v1/stop", "bert", content=b"{not json").status_code == 204
    site.until("/v1/state", lambda state: state["stopped"])
    assert site.ended(waiting["mission"]["id"])["status"] == "cancelled"
    assert problem(site.ask("POST", "/v1/missions", "commander", json={"text": ORDER}), 409)
    assert site.ask("POST", "/v1/release", "commander").status_code == 204
    site.until("/v1/state", lambda state: not state["stopped"])
    told = [event.data for event in pa.read_log(site.log) if event.data.kind == "all_stopped"]
    assert [stop.by for stop in told] == ["bert"]  # type: ignore[union-attr]


@pytest.mark.parametrize("path", READS)
def test_an_observer_reads_everything_and_nobody_reads_without_a_token(
    site: Site, path: str
) -> None:
    assert site.ask("GET", f"/v1/{path}", "observer").status_code == 200
    found = site.ask("GET", f"/v1/{path}", "")
    assert problem(found, 401)["field"] == "Authorization"
    assert found.headers["www-authenticate"].startswith("Bearer")
    assert problem(site.ask("GET", f"/v1/{path}", "pa_wrong"), 401)


@pytest.mark.parametrize("path", ["missions", "decisions", "stop", "release", "missions/x/cancel"])
def test_an_observer_commands_nothing(site: Site, path: str) -> None:
    body = {"text": ORDER} if path == "missions" else {}
    found = problem(site.ask("POST", f"/v1/{path}", "observer", json=body), 403)
    assert "observer" in found["detail"]
    assert problem(site.ask("POST", f"/v1/{path}", "", json=body), 401)


@pytest.mark.parametrize("host", ["evil.example", "localhost", "127.0.0.1:1", "evil.example:80"])
def test_a_name_that_leads_here_is_not_this_machine_s(site: Site, host: str) -> None:
    assert problem(site.ask("GET", "/v1/state", headers={"Host": host}), 421)["field"] == "Host"


def test_a_page_of_another_site_is_refused_and_one_of_ours_is_not(site: Site) -> None:
    foreign = site.ask("POST", "/v1/stop", headers={"Origin": "http://evil.example"})
    assert problem(foreign, 403)["field"] == "Origin"
    own = site.ask("GET", "/v1/state", headers={"Origin": site.address})
    assert own.status_code == 200
    assert "access-control-allow-origin" not in own.headers


def test_another_address_of_this_machine_is_not_listened_on(site: Site) -> None:
    port = int(site.address.rpartition(":")[2])
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", port), timeout=5)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"text": ""}, "text"),
        ({"text": "x" * 2001}, "text"),
        ({"text": 5}, "text"),
        ({"words": "go"}, "text"),
        ({"text": "go", "by": "carl"}, "by"),
        ([], ""),
    ],
)
def test_a_body_that_will_not_do_is_told_by_its_field(site: Site, body: object, field: str) -> None:
    found = problem(site.ask("POST", "/v1/missions", "commander", json=body), 422)
    assert found["field"] == field
    assert found["remedy"]


def test_what_is_too_large_broken_or_unknown_is_a_problem_without_a_traceback(site: Site) -> None:
    large = json.dumps({"text": "x" * MOST_BYTES}).encode()
    kind = {"Content-Type": "application/json"}
    assert problem(site.ask("POST", "/v1/missions", content=large, headers=kind), 413)
    pieces = (large[start : start + 9000] for start in range(0, len(large), 9000))
    chunked = site.ask("POST", "/v1/missions", "commander", content=pieces, headers=kind)
    assert problem(chunked, 413)
    for broken in (b"{", b"\xff\xfe", b"[" * 5000):
        assert problem(
            site.ask("POST", "/v1/missions", "commander", content=broken, headers=kind), 422
        )
    assert problem(site.ask("GET", "/v1/missions/M9", "observer"), 404)["field"] == "id"
    assert problem(site.ask("GET", "/v2", "observer"), 404)["remedy"]
    assert problem(site.ask("PUT", "/v1/state", "observer"), 405)


def test_events_are_streamed_and_taken_up_after_the_last_id(site: Site) -> None:
    waiting = site.waiting(ORDER)
    site.ask("POST", "/v1/decisions", json=decision(waiting, "reject"))
    site.ended(waiting["mission"]["id"])
    session = site.ask("GET", "/v1/state", "observer").json()["session"]
    whole = events(site, f"{session}.0", 12)
    assert [one["id"] for one in whole] == [f"{session}.{n}" for n in range(1, 13)]
    assert whole[0]["event"] == "session_started"
    logged = [event.data.kind for event in pa.read_log(site.log)][:12]
    assert [one["event"] for one in whole] == logged
    assert events(site, whole[4]["id"], 3) == whole[5:8]
    only = events(site, f"{session}.0", 1, "mission_received")
    assert json.loads(only[0]["data"])["data"]["mission"]["text"] == ORDER
    for last, code in (("elsewhere.3", 410), ("nonsense", 422)):
        refused = site.ask("GET", "/v1/events", "observer", headers={"Last-Event-ID": last})
        assert problem(refused, code)["field"] == "Last-Event-ID"


def test_a_stream_ends_when_its_token_is_revoked(site: Site) -> None:
    book = TokenBook(key_path().with_name(TOKENS_FILE))
    token = book.make("vera", "observer")
    with httpx.stream(
        "GET",
        f"{site.address}/v1/events",
        headers={"Authorization": f"Bearer {token}"},
        timeout=300,
    ) as answer:
        lines = answer.iter_lines()
        assert next(lines).startswith(": ")
        (row,) = book.listed()
        book.revoke(row.id)
        waiting = site.waiting(ORDER)
        assert not [line for line in lines if line]
    site.ask("POST", "/v1/decisions", json=decision(waiting, "reject"))
    site.ended(waiting["mission"]["id"])


def events(site: Site, last: str, count: int, kind: str = "") -> list[dict[str, str]]:
    """Return so many server-sent events after the one with the id `last`."""
    headers = {"Authorization": f"Bearer {site.tokens['observer']}", "Last-Event-ID": last}
    asked = {"kind": kind} if kind else {}
    found: list[dict[str, str]] = [{}]
    with httpx.stream(
        "GET", f"{site.address}/v1/events", params=asked, headers=headers, timeout=300
    ) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        for line in answer.iter_lines():
            name, _, value = line.partition(": ")
            if name:
                found[-1][name] = value
            elif found[-1].get("id"):
                found.append({})
            if len(found) > count:
                break
    return found[:count]


def test_the_description_is_there_and_loads_nothing_from_elsewhere(site: Site) -> None:
    page = site.ask("GET", "/docs", "").text
    assert "http://" not in page
    assert "https://" not in page
    described = site.ask("GET", "/openapi.json", "").json()
    assert {"/v1/state", "/v1/missions", "/v1/plans", "/v1/rules", "/v1/events"} <= set(
        described["paths"]
    )
    script = site.ask("GET", "/static-offline-docs/swagger-ui-bundle.js", "")
    assert script.status_code == 200


def test_a_program_and_its_clients_use_one_station(site: Site) -> None:
    assert {trace.mission.id for trace in site.station.state.missions.values()} == {
        one["id"] for one in site.ask("GET", "/v1/missions", "observer").json()
    }
    assert len([e for e in pa.read_log(site.log) if e.data.kind == "session_started"]) == 1


def test_the_program_of_the_page_is_served_to_whoever_reads_its_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    engine = ScriptedEngine([FILL]).engine()
    opened = partial(pa.open_station, engine=engine, log=tmp_path / "session.jsonl")
    monkeypatch.setattr(pa, "open_station", opened)
    told: list[str] = []
    clients: list[Thread] = []

    def client(address: str, token: str) -> None:
        headers = {"Authorization": f"Bearer {token}"}
        with httpx.Client(base_url=address.removesuffix("/docs"), headers=headers) as asks:
            while not (plans := asks.get("/v1/plans").json()):
                pass
            told.append(asks.post("/v1/decisions", json=decision(plans[0])).json()["by"])

    def printed(*words: str) -> None:
        if words[0].endswith("/docs"):
            clients.append(Thread(target=client, args=words, daemon=True))
            clients[-1].start()
        else:
            told.append(words[0])

    exec(compile(PROGRAM, "<program>", "exec"), {"__name__": "__main__", "print": printed})
    for one in clients:
        one.join(30)
    assert sorted(told) == ["ann", "verified"]
