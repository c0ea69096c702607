"""Hypothesis strategies for plans and rehearsals at the example checkpoint."""

from typing import Any

from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD, example_rehearsal
from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleExample

AGENTS = (*WORLD.assets, "Drone_T99")
FRAMES = (*WORLD.frames, "MoonGate")

_COMMANDS = [
    f"{verb} {frame}" if spec.takes_frame else verb
    for verb, spec in COMMANDS.items()
    for frame in FRAMES
]


def plans() -> st.SearchStrategy[Plan]:
    """Any plan, with now and then an unknown name or an agent twice."""
    action = st.builds(
        Action, agent=st.sampled_from(AGENTS), command=st.sampled_from(sorted(set(_COMMANDS)))
    )
    actions = st.lists(action, max_size=10).map(tuple)
    return st.builds(Plan, reason=st.text(max_size=40), actions=actions)


def rehearsals(plan: Plan) -> st.SearchStrategy[Rehearsal]:
    """What `plan` brings about in a random situation with failures, low batteries and tracks."""
    asset = st.fixed_dictionaries(
        {},
        optional={
            "status": st.sampled_from(["ok", "degraded", "failed"]),
            "comms": st.sampled_from(["ok", "degraded", "lost"]),
            "battery_pct": st.sampled_from([0.0, 10.0, 60.0]),
            "at": st.sampled_from([None, *WORLD.frames]),
            "task": st.sampled_from(["idle", "moving", "blocking"]),
        },
    )
    track = st.fixed_dictionaries(
        {"gate": st.sampled_from(WORLD.gates)},
        optional={
            "kind": st.sampled_from(["vehicle", "person"]),
            "identity": st.sampled_from(["unknown", "authorized", "unauthorized"]),
            "intent": st.sampled_from(["unknown", "benign", "hostile"]),
            "status": st.sampled_from(["approaching", "stopped", "leaving", "inside"]),
            "observed": st.booleans(),
            "warned": st.booleans(),
        },
    )
    given = st.fixed_dictionaries(
        {
            "assets": st.dictionaries(st.sampled_from(list(WORLD.assets)), asset),
            "tracks": st.dictionaries(st.sampled_from(["V1", "V2", "V3"]), track),
        }
    )

    def rehearse(values: dict[str, Any]) -> Rehearsal:
        return example_rehearsal(RuleExample(name="random", expect="pass", given=values), plan)

    return given.map(rehearse)
