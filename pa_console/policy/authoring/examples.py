"""Runs the examples of a rule: plans and moments that must pass or fail together.

Each entry of `moments` says what changes from the moment before. The first changes an uneventful
one at the example checkpoint: every gate covered, no tracks, no orders.

at       time in seconds; without it a second has passed
tracks   facts of tracks, e.g. {V1: {gate: WestGate, observed: true}}; {V1: null} takes it away
covered  whether gates are covered, e.g. {SouthGate: false}
up       whether the plan's assets are available, e.g. {Robot_T01: false}
orders   all orders under way, e.g. [[Ugv_T02, block WestGate], [Drone_T04, hold, done]]

A track of which no more than its gate is said is unknown, approaching, unobserved and unwarned.

Those of its orderings, with `moments`, are described in `policy.example_moments`.

`given` says how the situation differs from the example checkpoint (`policy.example_state`):

assets    facts of assets before the plan, e.g. {Drone_T03: {status: failed}}
tracks    tracks before the plan, e.g. {V1: {gate: WestGate, identity: unknown}}
gates     cover before the plan, where it does not follow from the assets
after     facts of the picture after the plan, laid over what the plan would bring about
timeline  facts of the rehearsal, laid over an uneventful one
sightings what was seen before, e.g. [{track: V1, place: Depot, noncombatants: true, age_s: 40}];
          of a track that is known at present, its present facts count
"""

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from pa_console.policy.authoring.example_situation import (
    WORLD,
    carried_out,
    example_timeline,
    overlay,
    situation,
)
from pa_console.policy.checks.findings import finding
from pa_console.policy.checks.rule_checks import check_rule
from pa_console.policy.checks.sightings import Sighting, Sightings
from pa_console.policy.ordering.monitor import Monitor
from pa_console.policy.rulebook import CompiledRule, Rulebook, compile_rule
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Moment, Rehearsal
from pa_console.schema.rule import Rule, RuleExample

CHANGES = ("at", "tracks", "covered", "up", "orders")
STEP_S = 1.0

Values = dict[str, Any]


def run_moments(entry: CompiledRule, example: RuleExample) -> Finding:
    """Return what the orderings of `entry` find over the moments of `example`, end included.

    Raises what `example_moments` raises.
    """
    monitor = Monitor(Rulebook("example", "", (entry,)), WORLD)
    found = [new for now in example_moments(example) for new in monitor.observe(now)]
    found += monitor.finish()
    return found[0] if found else finding(entry.rule, "complies")


def example_moments(example: RuleExample) -> tuple[Moment, ...]:
    """Return the moments of `example`.

    Raises ValueError for an unknown key, ValidationError for an impossible fact.
    """
    state: Values = {"time_s": -STEP_S, "covered": dict.fromkeys(WORLD.gates, True), "tracks": {}}
    moments: list[Moment] = []
    for number, change in enumerate(example.moments):
        unknown = sorted(set(change) - set(CHANGES))
        if unknown:
            known = ", ".join(CHANGES)
            raise ValueError(f"moments.{number}.{unknown[0]} is unknown; known: {known}")
        state = _changed(state, change)
        moments.append(Moment.model_validate_json(json.dumps(state)))
    return tuple(moments)


def _changed(state: Values, change: Values) -> Values:
    named: Values = change.get("tracks", {})
    known: Values = state["tracks"]
    tracks = known | {
        name: overlay(known.get(name) or _UNKNOWN, facts)
        for name, facts in named.items()
        if facts is not None
    }
    after: Values = {
        "time_s": change.get("at", state["time_s"] + STEP_S),
        "tracks": {n: t for n, t in tracks.items() if n not in named or named[n] is not None},
        "covered": state["covered"] | change.get("covered", {}),
        "up": state.get("up", {}) | change.get("up", {}),
        "orders": state.get("orders", []),
    }
    if "orders" in change:
        after["orders"] = [_order(order) for order in change["orders"]]
    return after


_UNKNOWN: Values = {
    "identity": "unknown",
    "intent": "unknown",
    "status": "approaching",
    "observed": False,
    "warned": False,
}


def _order(words: Iterable[object]) -> Values:
    agent, command, *rest = cast("list[str]", list(words))
    action = Action(agent=agent, command=command)
    kind = WORLD.assets[agent].kind
    target, done = action.target, rest == ["done"]
    return {"agent": agent, "kind": kind, "verb": action.verb, "target": target, "done": done}


GIVEN = ("assets", "tracks", "gates", "after", "timeline", "sightings")
MISSION_TEXT = "Secure the checkpoint."
_SIGHTINGS: TypeAdapter[list[Sighting]] = TypeAdapter(list[Sighting])


def run_example(rule: Rule, example: RuleExample) -> Finding:
    """Return what the check of `rule`, or its orderings, find for `example`.

    An example that makes no sense, or a check that does not compile, is a finding of status error.
    """
    try:
        entry = compile_rule(rule)
        if example.moments:
            return run_moments(entry, example)
        plan = example_plan(example)
        rehearsal = example_rehearsal(example, plan)
        sightings = example_sightings(example, rehearsal.before.time_s)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        return _wrong(rule, f"{place}: {first['msg']}")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        return _wrong(rule, f"{type(error).__name__}: {error}")
    mission = Mission(
        id="example", text=example.mission or MISSION_TEXT, created=datetime(2000, 1, 1, tzinfo=UTC)
    )
    return check_rule(
        entry,
        plan=plan,
        rehearsal=rehearsal,
        mission=mission,
        world=WORLD,
        sightings=sightings,
    )


def example_plan(example: RuleExample) -> Plan:
    """Return the plan of `example`; raises ValidationError for one that is not well-formed."""
    actions = [{"agent": agent, "command": command} for agent, command in example.plan]
    return Plan.model_validate_json(json.dumps({"reason": example.reason, "actions": actions}))


def example_rehearsal(example: RuleExample, plan: Plan) -> Rehearsal:
    """Return the situation of `example` and what its plan brings about.

    Raises ValueError for an unknown key of `given`, ValidationError for an impossible fact.
    """
    given = example.given
    unknown = sorted(set(given) - set(GIVEN))
    if unknown:
        raise ValueError(f"given.{unknown[0]} is unknown; known: {', '.join(GIVEN)}")
    before = situation(given)
    after = overlay(carried_out(before, plan), given.get("after", {}))
    timeline = overlay(example_timeline(before, after, plan), given.get("timeline", {}))
    values: dict[str, Any] = {"before": before, "after": after, "timeline": timeline}
    return Rehearsal.model_validate_json(json.dumps(values))


def example_sightings(example: RuleExample, now_s: float) -> Sightings:
    """Return the sightings before the plan of `example`, whose picture is of `now_s`.

    Raises TypeError for entries that are no mappings, ValidationError for an impossible fact.
    """
    facts: list[Any] = []
    for entry in example.given.get("sightings", ()):
        age_s: float = entry.get("age_s", 0.0)
        known = {key: value for key, value in entry.items() if key != "age_s"}
        facts.append({"gate": "", "stamp_s": now_s - age_s} | known)
    return Sightings(WORLD, _SIGHTINGS.validate_python(facts))


def _wrong(rule: Rule, problem: str) -> Finding:
    return Finding(
        rule_id=rule.id,
        priority=rule.priority,
        status="error",
        message=f"the example cannot be run: {problem}",
    )
