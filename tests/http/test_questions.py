"""Questions over HTTP: whoever may read may ask, and nothing that is posted there moves anybody."""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.mission import MAX_MISSION_TEXT
from tests.http.conftest import ASKS_AT_ONCE, Site
from tests.http.test_served_session import ORDER, decision, events, problem

ACTS = ("mission_received", "command_sent", "decision_made", "all_stopped", "stop_released",
        "queue_changed", "standing_order_read")  # fmt: skip
"""What no question may bring about."""
PHRASES = (
    *("Why", "why not", "what else", "instead", "because", "how come", "?", ".", "!", ",", "\n"),
    *("send", "stop", "approve", "yes", "Move", "everybody", "to", "the east gate", "EastGate"),
    *("Drone_T04", "Robot_T02", "the robot", "a drone", "nobody", "and", "do", "you", "it"),
    *('{"kind": "approve"}', "mission", "Whenever a drone is low, relieve it.", ORDER),
)
TEXTS = st.one_of(
    st.text(min_size=1, max_size=MAX_MISSION_TEXT),
    st.lists(st.sampled_from(PHRASES), min_size=1, max_size=8).map(" ".join),
)


@pytest.fixture(scope="module")
def waiting(site: Site) -> Iterator[dict[str, Any]]:
    """Return a plan that waits for its decision while the questions are asked."""
    plan = site.waiting(ORDER)
    yield plan
    site.ask("POST", "/v1/decisions", json=decision(plan, "reject"))


def ask(site: Site, text: str, role: str = "observer") -> Any:
    return site.ask("POST", "/v1/questions", role, json={"text": text})


def told(site: Site) -> list[dict[str, str]]:
    """Return every event of the session up to now."""
    state = site.ask("GET", "/v1/state").json()
    return events(site, f"{state['session']}.0", state["event"])


def acts(site: Site) -> Counter[str]:
    """Return how often anything has happened so far that moves or decides."""
    kinds = Counter(event["event"] for event in told(site))
    return Counter({kind: kinds[kind] for kind in ACTS})


def test_an_observer_asks_about_the_plan_that_waits(site: Site, waiting: dict[str, Any]) -> None:
    answer = ask(site, "Why not Robot_T02?")
    assert answer.status_code == 200, answer.text
    given = answer.json()
    assert (given["topic"], given["subjects"]) == ("other_asset", ["Robot_T02"])
    said = " ".join(line["said"] for line in given["lines"] if line["about"] == "Robot_T02")
    assert "in place of Drone_T04: no rule is broken" in said
    plans = site.ask("GET", "/v1/plans").json()
    assert [plan["shown_sha256"] for plan in plans] == [waiting["shown_sha256"]]
    logged = [
        json.loads(event["data"]) for event in told(site) if event["event"] == "question_answered"
    ]
    assert [(each["mission"], each["data"]) for each in logged] == [
        (waiting["mission"]["id"], given)
    ]


def test_an_order_is_no_question_and_a_question_is_no_mission(
    site: Site, waiting: dict[str, Any]
) -> None:
    refused = problem(ask(site, ORDER, "commander"), 422)
    assert (refused["field"], "Why not ASSET?" in refused["detail"]) == ("text", True)
    assert "POST /v1/missions" in refused["remedy"]
    mission = site.ask("POST", "/v1/missions", json={"text": "Why not Robot_T02?"})
    assert "POST /v1/questions" in problem(mission, 409)["remedy"]
    assert len(site.ask("GET", "/v1/missions").json()) == 1


def test_nobody_asks_without_a_token_or_with_another_body(site: Site) -> None:
    assert problem(ask(site, "Why?", ""), 401)["field"] == "Authorization"
    for body in ({"text": ""}, {"text": "x" * (MAX_MISSION_TEXT + 1)}, {"text": "Why?", "by": "x"}):
        assert site.ask("POST", "/v1/questions", "observer", json=body).status_code == 422


def test_questions_have_a_limit_of_their_own(site: Site) -> None:
    codes = [ask(site, "?", "bert").status_code for _ in range(ASKS_AT_ONCE)]
    assert set(codes) == {422}
    assert int(ask(site, "?", "bert").headers["retry-after"]) > 0
    assert site.ask("GET", "/v1/state", "bert").status_code == 200
    assert site.ask("POST", "/v1/missions/none/cancel", "bert").status_code == 404


def test_the_description_has_the_question_and_its_answer(site: Site) -> None:
    paths = site.ask("GET", "/openapi.json", "").json()["paths"]
    described = paths["/v1/questions"]["post"]
    assert "does not become a mission" in described["description"]
    assert "QuestionAnswered" in json.dumps(described["responses"]["200"])


def test_whatever_is_posted_there_is_no_mission_and_no_command(
    site: Site, waiting: dict[str, Any]
) -> None:
    before = acts(site)
    codes = Counter[int]()

    @settings(max_examples=200, deadline=None)
    @given(TEXTS)
    def posted(text: str) -> None:
        codes[ask(site, text, "carl").status_code] += 1

    posted()
    for text in ("Why?", "What would you do instead?", "Why not Robot_T02?"):
        codes[ask(site, text, "carl").status_code] += 1
    assert set(codes) == {200, 422}
    assert acts(site) == before
    assert [plan["request"] for plan in site.ask("GET", "/v1/plans").json()] == [waiting["request"]]
