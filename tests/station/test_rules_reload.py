"""A changed rule file is taken while a session runs; what was begun keeps the rules it had."""

from contextlib import aclosing
from dataclasses import replace
from pathlib import Path

import pytest

from pa_console.policy.rule_seal import content_sha256, sign_rules
from pa_console.policy.rulebook import load_rules, read_rule_set
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.session.state import SessionState
from pa_console.signing import KEY_VARIABLE, load_signer
from pa_console.station import rules_in_force
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.rules_in_force import RulesWatch
from pa_console.station.station import ControlStation
from tests.scripted import ScriptedEngine, plan

RULES = """\
name: house
rules:
  - id: CAP-01
    domain: CAP
    priority: high
    text: "Nobody needs to move."
    check: "true"
    message: "it moves"
"""
STRICT = RULES.replace('"true"', '"size(actions) == 0"')
BROKEN = RULES.replace('"true"', '"size("')
OTHER = Plan(reason="mine", actions=(Action(agent="Drone_T04", command="report"),))


@pytest.fixture
def rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key.pem"))
    path = tmp_path / "house.yaml"
    path.write_text(RULES)
    return path


def watching(rules: Path, *, unsigned: bool = False) -> ControlStation:
    engine = ScriptedEngine([plan(("Drone_T04", "report"))]).engine()
    watch = RulesWatch(rules, unsigned=unsigned)
    site = load_site("checkpoint", str(rules), unsigned=unsigned)
    return open_station(site, engine, SteppedClock(), watch=watch)


async def test_the_running_mission_is_pinned_to_the_rules_it_was_begun_with(rules: Path) -> None:
    station, state, told = watching(rules), SessionState(), list[ev.Event]()
    old = content_sha256(read_rule_set(rules)[1])
    station.submit("All drones report.")
    requests = 0
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            told.append(event)
            if isinstance(event.data, ev.ApprovalRequested):
                requests += 1
                if requests == 1:
                    rules.write_text(STRICT)
                    await station.reload_rules()
                    station.submit("All robots report.")
                    station.decide(Decision(kind="modify", plan=OTHER))
                else:
                    station.decide(Decision(kind="reject"))
            if sum(event.data.kind == "mission_finished" for event in told) == 2:
                break
    new = content_sha256(read_rule_set(rules)[1])
    first, second = state.missions.values()
    assert (first.rules, second.rules) == (old, new)
    own = [
        [found.status for a in trace.attempts for found in a.findings if found.rule_id == "CAP-01"]
        for trace in (first, second)
    ]
    assert own == [["complies"] * 2, ["violates"] * len(own[1])]
    assert own[1]
    (replaced,) = (e.data for e in told if isinstance(e.data, ev.RulesReplaced))
    assert replaced.changes == ("CAP-01 changed",)
    assert content_sha256(replaced.rule_set) == replaced.rules_seal.content_sha256 == new
    assert replaced.rules_sha256 == load_rules(rules).sha256
    words = [e.data.text for e in told if isinstance(e.data, ev.Noticed)]
    assert any(f"{first.mission.id} continues under its earlier rules" in text for text in words)
    assert state.started is not None
    assert state.started.rules_seal == replaced.rules_seal


async def test_what_is_typed_is_read_with_the_rules_that_are_in_force_now(rules: Path) -> None:
    engine = ScriptedEngine([])
    engine.model = replace(engine.model, prompts="compact")
    watch, site = RulesWatch(rules), load_site("checkpoint", str(rules))
    station = open_station(site, engine.engine(), SteppedClock(), watch=watch)
    await station.read_ahead("nobody needs to move")
    rules.write_text(RULES.replace("Nobody needs to move", "Everybody may move"))
    await station.reload_rules()
    await station.read_ahead("nobody needs to move")
    before, after = engine.warmed[0][2], engine.warmed[-2][2]
    assert "\nCAP-01: Nobody needs to move" in before
    assert "\nCAP-01: Everybody may move" in after


async def reload(station: ControlStation) -> list[ev.EventPayload]:
    """Let the station look at its file; return what it told after its start."""
    await station.reload_rules()
    await station.close()
    return [e.data async for e in station.run() if e.data.kind in ("rules_replaced", "noticed")]


async def test_a_broken_file_leaves_the_old_set_in_force_and_says_why(rules: Path) -> None:
    station = watching(rules)
    rules.write_text(BROKEN)
    (told,) = await reload(station)
    assert isinstance(told, ev.Noticed)
    assert (told.level, told.subject) == ("alarm", "rules")
    assert "stays in force" in told.text
    assert "house.yaml:7: rules.0.check: not valid CEL" in told.text
    station = watching_again(rules)
    rules.unlink()
    (told,) = await reload(station)
    assert isinstance(told, ev.Noticed)
    assert "No such file" in told.text


def watching_again(rules: Path) -> ControlStation:
    rules.write_text(RULES)
    return watching(rules)


async def test_a_signed_set_that_is_altered_is_taken_only_unsigned(rules: Path) -> None:
    sign_rules(rules, read_rule_set(rules)[1], load_signer())
    station = watching(rules)
    rules.write_text(STRICT)
    (told,) = await reload(station)
    assert isinstance(told, ev.Noticed)
    assert "ALTERED since it was signed" in told.text
    rules.write_text(RULES)
    station = watching(rules, unsigned=True)
    rules.write_text(STRICT)
    replaced, _ = await reload(station)
    assert isinstance(replaced, ev.RulesReplaced)
    assert replaced.rules_seal.altered


async def test_a_file_that_says_the_same_is_no_change(rules: Path) -> None:
    station = watching(rules)
    rules.write_text(f"# a comment\n{RULES}")
    assert await reload(station) == []


async def test_a_change_of_the_file_is_found_by_itself(
    rules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rules_in_force, "LOOK_S", 0.001)
    station, seen = watching(rules), list[str]()
    async with aclosing(station.run()) as events:
        async for event in events:
            if event.data.kind == "telemetry" and "written" not in seen:
                rules.write_text(STRICT)
                seen.append("written")
            if event.data.kind == "rules_replaced":
                seen.append("replaced")
                break
    assert seen == ["written", "replaced"]


async def test_rules_are_found_among_those_that_were_taken(rules: Path) -> None:
    station = watching(rules)
    before = station.retriever
    rules.write_text(RULES.replace("CAP-01", "CAP-02"))
    await reload(station)
    assert "CAP-02" not in before.rank("who moves", 20)
    assert "CAP-02" in station.retriever.rank("who moves", 20)
