"""Standing approval takes nothing that may have been misread, however green the judge is."""

import math
from collections.abc import AsyncGenerator, Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.cli.sessions import mission as mission_session
from pa_console.llm.backend import GenerationEnd, Request
from pa_console.llm.models.catalogue import LocalModel
from pa_console.mission.approval import (
    CheckedPlan,
    OrderAsRead,
    request_approval,
    standing_approver,
)
from pa_console.schema.finding import Verdict
from pa_console.schema.plan import Plan
from pa_console.session.confidence import UNSURE, Evidence, calibrated_confidence
from pa_console.session.mission_trace import Attempt
from tests.cli.inside import Call
from tests.scripted import ScriptedEngine, judged, plan

pytestmark = pytest.mark.invariant


class Readers(ScriptedEngine):
    """A planner and a judge that read what they are told, each as sure as it is told."""

    mute = False
    """Whether they do not tell how sure they are."""

    def read(
        self,
        asked: str,
        *orders: tuple[str, str],
        reads: str = "",
        sure: float = 0.99,
        judge: float = 0.99,
    ) -> None:
        """Let the planner read `asked`, and the judge `reads`, or the same, and say Success."""
        answer = plan(*orders, reason=f"asked: {asked}; Free drone: Drone_T04")
        opening, verdict = judged(f"asked: {reads or asked}")
        self._answers = {"planner": [answer], "judge": [opening, verdict]}
        self.model = replace(self.model, prompts="compact")
        self._told = {"planner": (answer, sure), "judge": (opening, judge)}

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Answer with the chances of whoever is asked."""
        text, sure = self._told.get(request.role, ("", 1.0))
        self._chances = () if self.mute else ((text.find("asked: ") + 1, math.log(sure)),)
        async for piece in super().generate(request):
            yield piece


@pytest.fixture
def models(monkeypatch: pytest.MonkeyPatch) -> Readers:
    """Put models that read as they are told in the place of the real one."""
    readers = Readers([])

    def find_model(_: str | None, *_progress: object, **_reader: str) -> LocalModel:
        return readers.model

    def new_engine(_: LocalModel, **_options: bool) -> Readers:
        return readers

    monkeypatch.setattr(mission_session, "find_model", find_model)
    monkeypatch.setattr(mission_session, "Engine", new_engine)
    return readers


Auto = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def auto(call: Call) -> Auto:
    """Return what gives a mission under standing approval: its exit code and what became of it."""

    def give(text: str) -> tuple[int, dict[str, Any]]:
        done = call("mission", text, "--approve", "auto", "--json")
        return done.code, done.json["mission"]

    return give


EVERYBODY = tuple((name, "move_to WestGate") for name in ("Drone_T04", "Ugv_T02", "Robot_T01"))


def test_an_order_to_the_base_that_both_read_as_to_a_gate_moves_nobody(
    auto: Auto, models: Readers
) -> None:
    models.read("all free to WestGate", *EVERYBODY)
    code, done = auto("Send all assets to base.")
    assert (code, done["status"], done["commands"]) == (3, "rejected", {})
    assert "not accounted for: base" in done["reason"]
    assert "not in the order's words: WestGate" in done["reason"]


def test_an_order_that_demands_and_forbids_the_same_moves_nobody(
    auto: Auto, models: Readers
) -> None:
    orders = (("Drone_T01", "return_to_base"), ("Drone_T04", "move_to WestGate"))
    models.read("Drone_T01 home", *orders)
    code, done = auto("Send Drone_T01 home. Do not send Drone_T01 home.")
    assert (code, done["status"], done["commands"]) == (3, "held", {})
    assert "“Send Drone_T01 home” and “Do not send Drone_T01 home” contradict" in done["reason"]


def test_an_order_read_rightly_and_surely_is_carried_out(auto: Auto, models: Readers) -> None:
    models.read("1 drone to EastGate", ("Drone_T04", "move_to EastGate"))
    code, done = auto("Send one drone to the east gate.")
    assert (code, done["status"]) == (0, "verified"), done["reason"]


@pytest.mark.parametrize(("sure", "judge"), [(0.5, 0.99), (0.99, 0.5), (0.69, 0.69)])
def test_what_either_model_doubts_is_held(
    auto: Auto, models: Readers, sure: float, judge: float
) -> None:
    order = ("Drone_T04", "move_to EastGate")
    models.read("1 drone to EastGate", order, sure=sure, judge=judge)
    code, done = auto("Send one drone to the east gate.")
    assert (code, done["commands"]) == (3, {})
    told = calibrated_confidence(Evidence(sure, judge))
    assert told is not None
    assert f"read with {told:.0%} confidence, 90% are needed" in done["reason"]


def test_models_that_do_not_tell_how_sure_they_are_do_not_move_anybody_unseen(
    auto: Auto, models: Readers
) -> None:
    models.read("1 drone to EastGate", ("Drone_T04", "move_to EastGate"), sure=1.0)
    models.mute = True
    code, done = auto("Send one drone to the east gate.")
    assert (code, done["commands"]) == (3, {})
    assert "how sure they are" in done["reason"]


def test_a_judge_that_reads_something_else_and_says_success_anyway_is_no_witness(
    auto: Auto, models: Readers
) -> None:
    order = ("Drone_T04", "move_to EastGate")
    models.read("1 drone to EastGate", order, reads="1 drone to NorthGate")
    code, done = auto("Send one drone to the east gate.")
    assert (code, done["commands"]) == (5, {}), "it may be chosen between the readings"
    assert "another reader reads the order otherwise" in done["reason"]


@pytest.mark.parametrize(
    "text",
    ["Lovely weather, a blue sky.", "42", "😀😀", "el perro come una manzana roja", "...!?"],
)
def test_a_text_that_asks_for_nothing_moves_nobody(auto: Auto, models: Readers, text: str) -> None:
    models.read("1 drone to EastGate", ("Drone_T04", "move_to EastGate"))
    code, done = auto(text)
    assert (code, done["commands"]) == (3, {})


@settings(deadline=None)
@given(
    st.none() | st.floats(0.0, 1.0),
    st.lists(st.text(min_size=1, max_size=9), max_size=2),
    st.booleans(),
    st.floats(0.01, 1.0),
)
def test_no_doubt_is_ever_approved_by_a_standing_instruction(
    confidence: float | None, gaps: list[str], apart: bool, least: float
) -> None:
    request = request_approval(
        "M1.1",
        1,
        CheckedPlan(Plan(reason="", actions=()), verdict=Verdict(verdict="Success")),
        OrderAsRead(gaps=tuple(gaps), confidence=confidence, read_apart=apart),
    )
    decision = standing_approver("auto", "whatever", least=least)(request)
    sure = confidence is not None and confidence >= max(least, UNSURE)
    sound = sure and not gaps and not apart
    assert decision.kind == ("approve" if sound else "reject")
    assert decision.reason


def test_an_operator_sees_less_confidence_and_what_is_not_accounted_for() -> None:
    attempt = Attempt(1, confidence=0.98, judge_confidence=0.95)
    sure = attempt.sure
    assert sure is not None
    assert (sure >= UNSURE, attempt.doubt) == (True, "")
    attempt.gaps = ("not accounted for: base",)
    assert attempt.sure is not None
    assert attempt.sure < min(sure, UNSURE)
    assert "not accounted for: base" in attempt.doubt


DESCRIBED = "Swap Drone_T01 with the one at the Checkpoint."
SWAP = (("Drone_T01", "move_to Checkpoint"), ("Drone_T04", "move_to WestGate"))


def test_models_that_are_sure_settle_which_asset_is_described(auto: Auto, models: Readers) -> None:
    models.read("swap Drone_T01 and Drone_T04", *SWAP)
    code, done = auto(DESCRIBED)
    assert (code, done["status"]) == (0, "verified"), done["reason"]


@pytest.mark.parametrize(
    ("asked", "sure"),
    [("swap Drone_T01 and Drone_T04", 0.6), ("swap Drone_T01 and Drone_T02", 0.99)],
)
def test_it_is_asked_which_asset_is_described_where_they_are_not_or_name_another(
    auto: Auto, models: Readers, asked: str, sure: float
) -> None:
    other = "Drone_T02" if "T02" in asked else "Drone_T04"
    models.read(asked, SWAP[0], (other, "move_to WestGate"), sure=sure)
    code, done = auto(DESCRIBED)
    assert (code, done["commands"]) == (5, {})
    assert "3 assets fit “the one at the Checkpoint”. Which one is meant?" in done["reason"]
