"""Other rules over a recorded session: what would turn is named, what nobody can tell too."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from pa_console.evaluation.changed_decisions import ChangedDecision, SessionEffect, rules_turned
from pa_console.evaluation.recorded_decisions import decided_again, effect_on_session
from pa_console.mission.approval import standing_approver
from pa_console.policy.rulebook import CompiledRule, Rulebook, compile_rule, load_rules
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.schema.incident import SpawnTrack
from pa_console.schema.rule import Ordering, Rule, RuleSet, RulesSeal
from pa_console.schema.world import Zone
from pa_console.station.assembly import SessionSites, Site, load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from tests.evaluation.sessions import IDENTIFY, RECON, WARN, play, scenario
from tests.policy.book import RULES, checkpoint_rules
from tests.rig import MISSION
from tests.scripted import ScriptedEngine, plan

Events = Sequence[ev.Event]
SITE = load_site("checkpoint", "checkpoint")
BLOCK = plan(("Ugv_T02", "block WestGate"))
SPAWN = SpawnTrack(gate="WestGate", distance_m=40.0)


def recorded(
    answer: str, text: str = MISSION, site: Site = SITE, spawn: SpawnTrack = SPAWN
) -> Events:
    """Return the events of one mission, without workflows, whose planner answers the same."""
    engine = ScriptedEngine([answer]).engine()
    station = open_station(site, engine, SteppedClock(), variant=Variant(workflows=False))
    events: list[ev.Event] = []
    asyncio.run(
        run_missions(
            station,
            [text],
            standing_approver("auto"),
            lambda event, _: events.append(event),
            [spawn],
        )
    )
    return events


@pytest.fixture(scope="module")
def observed() -> Events:
    """Return a session in which a drone looked at a vehicle."""
    return recorded(RECON)


@pytest.fixture(scope="module")
def blocked() -> Events:
    """Return a session in which the planner wanted nothing but to block an unknown vehicle."""
    return recorded(BLOCK)


def with_rule(**fields: Any) -> Rulebook:
    """Return the shipped rules and one more."""
    rule = Rule.model_validate(
        {"id": "ROE-99", "domain": "ROE", "priority": "high", "text": "x", "message": "not so"}
        | fields
    )
    book = checkpoint_rules()
    return Rulebook("more", "", (*book.compiled, compile_rule(rule)), book.workflows)


def changed(rule_id: str, **fields: Any) -> Rulebook:
    """Return the shipped rules with one of them changed."""

    def other(entry: CompiledRule) -> CompiledRule:
        if entry.rule.id != rule_id:
            return entry
        return compile_rule(entry.rule.model_copy(update=fields))

    book = checkpoint_rules()
    return Rulebook("other", "", tuple(other(entry) for entry in book.compiled), book.workflows)


def effect(events: Events, new: Rulebook, was: Rulebook | None = None) -> SessionEffect:
    """Return what `new` rules would change in a session that ran with the shipped ones."""
    return effect_on_session(events, SITE.world, new, was or checkpoint_rules())


def kinds(found: SessionEffect) -> list[tuple[str, str, str]]:
    """Return kind, before and after of every flip."""
    return [(flip.kind, flip.was, flip.now) for flip in found.flips]


def test_the_same_rules_turn_nothing_and_leave_nothing_out(observed: Events) -> None:
    found = effect(observed, checkpoint_rules())
    assert (found.flips, found.gaps) == ([], [])
    assert (found.missions, found.plans) == (1, 1)
    assert found.compared == len(checkpoint_rules().rules)


def test_a_workflow_of_several_plans_comes_out_the_same() -> None:
    engine = ScriptedEngine([RECON, IDENTIFY, WARN])
    events = asyncio.run(play(SITE, engine, scenario((1.0, SPAWN)), seed=2))
    found = effect(events, checkpoint_rules())
    assert (found.flips, found.gaps) == ([], [])
    assert found.plans >= 2


def test_a_new_rule_turns_the_finding_the_plan_and_the_decision(observed: Events) -> None:
    new = with_rule(check="!actions.exists(a, a.verb == 'observe')")
    found = effect(observed, new)
    assert kinds(found) == [
        ("finding", "no such rule", "violates (high)"),
        ("plan", "not blocked", "blocked"),
        ("decision", "approve accepted", "approve refused"),
    ]
    assert {flip.rules for flip in found.flips} == {("ROE-99",)}
    assert {flip.plan for flip in found.flips} == {"Drone_T04 observe WestGate"}
    assert "cannot be approved by anyone: ROE-99: not so" in found.flips[2].words
    assert list(rules_turned(found.flips)) == [("ROE-99", 3)]
    assert kinds(effect_on_session(observed, SITE.world, new)) == kinds(found)


def test_a_medium_rule_asks_for_an_acknowledgement(observed: Events) -> None:
    new = with_rule(check="size(actions) == 0", priority="medium")
    assert kinds(effect(observed, new)) == [
        ("finding", "no such rule", "violates (medium)"),
        ("decision", "approve accepted", "approve refused"),
    ]


def test_a_rule_that_sees_what_was_seen_gets_it_from_the_recorded_telemetry(
    observed: Events,
) -> None:
    seen = (
        "!(actions.exists(a, a.goes_to == 'WestGate')"
        " && sightings.exists(s, s.gate == 'WestGate' && s.age_s < {}))"
    )
    assert len(effect(observed, with_rule(check=seen.format("60.0"))).flips) == 3
    assert effect(observed, with_rule(check=seen.format("-1.0"))).flips == []


@pytest.mark.parametrize("harmless", [True, False])
def test_nobody_is_sent_where_a_noncombatant_was_seen_a_minute_ago(harmless: bool) -> None:
    field = Zone(kind="restricted", polygon=((-90, -15), (-45, -15), (-45, 15), (-90, 15)))
    world = SITE.world.model_copy(update={"zones": {"Field": field}})
    entries = checkpoint_rules().compiled
    open_to_all = tuple(entry for entry in entries if entry.rule.id != "ROE-07")
    old = Rulebook("open", "", open_to_all)
    site = Site(world, SITE.world_path, old)
    spawn = SPAWN.model_copy(update={"noncombatants": harmless})
    events = recorded(RECON, MISSION, site, spawn)
    new = load_rules(RULES.parents[1] / "tests" / "policy" / "rule_files" / "noncombatants.yaml")
    found = effect_on_session(events, world, Rulebook("new", "", open_to_all + new.compiled), old)
    assert found.gaps == []
    assert [(flip.kind, flip.rules) for flip in found.flips] == [
        (kind, ("ROE-11",)) for kind in ("finding", "plan", "decision") if harmless
    ]
    assert all("Drone_T04 into Field" in flip.words for flip in found.flips)


def test_a_plan_that_nothing_blocks_any_more_is_named(blocked: Events) -> None:
    new = changed("ROE-02", check="true", order=())
    found = effect(blocked, new)
    turned = [flip for flip in found.flips if flip.kind == "finding"]
    assert {(f.rules, f.was, f.now) for f in turned} == {
        (("ROE-02",), "violates (critical)", "complies")
    }
    assert not [flip for flip in found.flips if flip.kind == "plan"]  # others block it still
    lax = Rulebook("lax", "", ())
    freed = [flip for flip in effect(blocked, lax).flips if flip.kind == "plan"]
    assert {(flip.was, flip.now) for flip in freed} == {("blocked", "not blocked")}
    assert "ROE-02" in freed[0].rules


def test_a_mission_that_would_be_refused_is_named(observed: Events) -> None:
    found = effect(observed, with_rule(check="!mission.words.contains('watch')"))
    first: ChangedDecision = found.flips[0]
    assert (first.kind, first.was, first.now, first.attempt) == ("intake", "taken", "refused", 0)
    refused = recorded(RECON, "Shoot the driver.")
    lax = effect(refused, changed("ROE-01", check="true"))
    assert kinds(lax) == [("intake", "refused", "taken")]
    assert effect(refused, checkpoint_rules()).gaps == []


def test_an_ordering_that_halts_a_running_plan_is_named(observed: Events) -> None:
    order = Ordering(
        kind="never_while",
        event="now.orders.exists(o, o.verb == 'observe')",
        other="true",
        message="somebody looks",
    )
    found = effect(observed, with_rule(message="", order=(order,)))
    assert ("halt", "ROE-99") in {(flip.kind, *flip.rules) for flip in found.flips}
    halt = next(flip for flip in found.flips if flip.kind == "halt")
    assert halt.was == "went on"
    assert halt.now.startswith("halted at ")


def test_rules_that_were_changed_in_the_session_are_those_it_goes_on_with() -> None:
    book = with_rule(check="size(actions) == 0", priority="medium")
    events = list(recorded(RECON, site=Site(SITE.world, SITE.world_path, book)))
    assert {gap.rule for gap in effect(events, book).gaps} == {"ROE-99"}
    told = ev.RulesReplaced(
        rules="more",
        rules_sha256="0" * 64,
        rules_seal=RulesSeal(),
        changes=("ROE-99 added",),
        rule_set=RuleSet(name="more", rules=book.rules),
    )
    events.insert(1, events[0].model_copy(update={"data": told}))
    found = effect(events, book)
    assert (found.flips, found.gaps) == ([], [])
    began_with = checkpoint_rules()
    assert effect_on_session(events, SITE.world, began_with).flips
    again = decided_again(events, SITE.world, began_with)
    assert (again.plans, again.flips) == (1, [])


def test_what_does_not_come_out_again_is_a_gap_and_no_flip(observed: Events) -> None:
    def other(event: ev.Event) -> ev.Event:
        if not isinstance(event.data, ev.PlanChecked):
            return event
        findings = tuple(
            finding.model_copy(update={"status": "violates"})
            if finding.rule_id == "ROE-06"
            else finding
            for finding in event.data.findings
        )
        return event.model_copy(
            update={"data": event.data.model_copy(update={"findings": findings})}
        )

    found = effect([other(event) for event in observed], checkpoint_rules())
    assert found.flips == []
    assert [(gap.rule, gap.attempt) for gap in found.gaps] == [("ROE-06", 1)]
    assert "the same rules now give 'complies'" in found.gaps[0].reason


def test_a_plan_without_a_rehearsal_is_a_gap(observed: Events) -> None:
    rest = [event for event in observed if not isinstance(event.data, ev.PlanRehearsed)]
    found = effect(rest, checkpoint_rules())
    assert (found.plans, [gap.reason for gap in found.gaps]) == (
        0, ["the plan was not rehearsed in the session"]
    )  # fmt: skip


def test_world_and_rules_of_a_session_are_found_by_their_hashes(
    observed: Events, tmp_path: Path
) -> None:
    started = observed[0].data
    assert isinstance(started, ev.SessionStarted)
    log = tmp_path / "logs" / "session.jsonl"
    sites = SessionSites()
    assert sites.world_of(started, log) == SITE.world
    assert sites.rules_of(started) is not None
    lost = started.model_copy(update={"world_sha256": "0" * 64, "rules_seal": None})
    with pytest.raises(ValueError, match="give its file with --world"):
        sites.world_of(lost, log)
    assert sites.rules_of(lost.model_copy(update={"rules_sha256": "0" * 64})) is None
    beside = tmp_path / "worlds" / "own" / "world.yaml"
    beside.parent.mkdir(parents=True)
    beside.write_bytes(SITE.world_path.read_bytes())
    elsewhere = started.model_copy(update={"world": "elsewhere"})
    assert sites.world_of(elsewhere, log) == SITE.world
    assert SessionSites().world_of(elsewhere, log) == SITE.world
