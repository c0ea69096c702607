"""Runs the examples of a rule's orderings: moments that must pass or fail together.

Each entry of `moments` says what changes from the moment before. The first changes an uneventful
one at the example checkpoint: every gate covered, no tracks, no orders.

at       time in seconds; without it a second has passed
tracks   facts of tracks, e.g. {V1: {gate: WestGate, observed: true}}; {V1: null} takes it away
covered  whether gates are covered, e.g. {SouthGate: false}
up       whether the plan's assets are available, e.g. {Robot_T01: false}
orders   all orders under way, e.g. [[Ugv_T02, block WestGate], [Drone_T04, hold, done]]

A track of which no more than its gate is said is unknown, approaching, unobserved and unwarned.
"""

import json
from collections.abc import Iterable
from typing import Any, cast

from pa_console.policy.example_state import WORLD, overlay
from pa_console.policy.findings import finding
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import CompiledRule, Rulebook
from pa_console.schema.finding import Finding
from pa_console.schema.moment import Moment
from pa_console.schema.plan import Action
from pa_console.schema.rule import RuleExample

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
