"""A sample cut down to its reading is the beginning of the whole one, token for token."""

import pytest

from pa_console.language.canonical.reading import read_asked, read_reason
from pa_console.llm.models.catalogue import LocalModel
from pa_training.adapters.material import Tokeniser
from pa_training.samples.readings import judge_readings, reading_of, readings
from pa_training.samples.sample import Sample
from tests.llm.conftest import smallest_model

__all__ = ["smallest_model"]

REASONS = {
    "asked: 1 drone to EastGate; Free drone: Hawk_1": "asked: 1 drone to EastGate; Free",
    "asked: EastGate; others stay; Hawk_1: alone": "asked: EastGate; others stay; Hawk_1:",
    "asked: hold": 'asked: hold",',
    "asked: if drone free: all hold, else: nothing; now: Free drone: none, not so; nothing": (
        "asked: if drone free: all hold, else: nothing; now: Free drone: none, not so; nothing"
    ),
}


def sample(reason: str, group: str = "g") -> Sample:
    return Sample(
        group=group,
        system="Plan the mission.",
        picture="EastGate: nobody\n",
        rest='WF-01: Look first.\nMission: "look: \\nMission: all"',
        answer=f'{{"reason": "{reason}", "actions": [{{"agent": "Hawk_1", "command": "hold"}}]}}',
        task="planner",
        kind="go/plain",
    )


@pytest.mark.parametrize("reason", REASONS)
def test_rules_facts_and_commands_are_left_out(reason: str, smallest_model: LocalModel) -> None:
    whole = sample(reason)
    short = reading_of(whole)
    assert short.rest == 'Mission: "look: \\nMission: all"'
    assert short.answer.rstrip('", ') == f'{{"reason": "{REASONS[reason]}'.rstrip('", ')
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    learnt = tokeniser.row(short)["targets"]
    assert learnt == tokeniser.row(whole)["targets"][: len(learnt)]


def test_a_reason_without_a_reading_stays_whole() -> None:
    assert reading_of(sample("the gate is open")) == sample("the gate is open")


def test_whole_groups_are_cut_down_as_many_as_are_asked_for() -> None:
    samples = [sample("asked: hold; Hawk_1: free", f"g{n // 2}") for n in range(400)]
    cut = [each.goes_on for each in readings(samples, 0.25, seed=3)]
    assert cut[::2] == cut[1::2]
    assert 30 < cut[::2].count(True) < 70
    assert not any(each.goes_on for each in readings(samples, 0.0, seed=3))
    assert all(each.goes_on for each in readings(samples, 1.0, seed=3))


@pytest.mark.parametrize("reason", REASONS)
def test_the_judge_reads_what_the_planner_read(reason: str, smallest_model: LocalModel) -> None:
    (read,) = judge_readings([sample(reason)])
    assert (read.task, read.system) == ("judge", "Judge the plan.")
    assert read.rest == reading_of(sample(reason)).rest
    asked = read.answer.removeprefix('{"feedback": "').removesuffix("; planned")
    assert reason.startswith(asked)
    assert asked.startswith("asked: ")
    assert read_asked(asked) == read_reason(reason)
    whole = read.model_copy(
        update={
            "answer": f'{read.answer}: 1 drone to EastGate; it fits", "verdict": "Success"}}',
            "goes_on": False,
        }
    )
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    learnt = tokeniser.row(read)["targets"]
    assert learnt == tokeniser.row(whole)["targets"][: len(learnt)]


def test_the_judge_learns_nothing_of_a_reason_without_a_reading() -> None:
    assert list(judge_readings([sample("the gate is open")])) == []
