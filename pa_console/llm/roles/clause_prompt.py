"""The prompt by which a model without training for orders reads one.

It has the forms of clauses, the picture, and those taught orders that are most like the one to
read. The answer is the beginning of a plan; the console makes the rest of it.
"""

import json
from collections.abc import Iterator, Sequence

from pa_console.language.clauses import ASKED
from pa_console.language.facts import told_assets, told_frames, tracks_of_digest
from pa_console.language.name_linking import link_names
from pa_console.llm.roles.answer_schema import TEXT, Schema
from pa_console.llm.roles.prompts import Prompt, mission_line
from pa_console.llm.roles.taught_orders import TaughtOrder, nearest_orders
from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import KINDS, PLAIN_KINDS, World

READER = """\
Read an order to a team at a checkpoint and say what it asks, in these clauses and no other words.
Do not plan it. Write one JSON object. Several clauses are separated by "; ".
WHO to PLACE: be there, go there. WHO look at GATE: watch, see what is there.
identify at GATE: find out who it is. warn at GATE: tell somebody to leave. block GATE: close it.
unknown vehicle at GATE, unknown person at GATE: somebody is there, see to it.
cover GATE: it has no guard. relieve ASSET at GATE, WHO relieves ASSET at GATE: another takes over.
swap ASSET and ASSET. stand down GATE: too many are there. all free to GATE: everybody who can.
WHO home: back to base. WHO hold, hold: stay, do nothing. report, report by WHO: tell, a question.
use force, chase beyond the perimeter, leave GATE without guard: what nobody may do.
Before a clause: "WHO ", or nothing where it is left open. After a clause, if the order says so:
without identification, without warning, with noncombatants; at the end: others stay.
if CONDITION: CLAUSE, else: CLAUSE or nothing.
WHO is an asset's name, or a number with a kind: 1 drone, 2 vehicles, 1 robot, all drones.
A place that does not exist is "unknown place".
"""

SCHEMA: Schema = {
    "type": "object",
    "properties": {"reason": TEXT},
    "required": ["reason"],
    "additionalProperties": False,
}
MAX_TOKENS = 160
"""The longest answer; room for it is kept in the context."""
SHOWN = 8
"""Taught orders that a prompt has."""


def reading_prompt(
    world: World,
    digest: Digest,
    _rules: Sequence[Rule],
    mission: Mission,
    repair: Sequence[str] = (),
    previous: str = "",
) -> Prompt:
    """Return the prompt for reading an order: clauses, picture, orders like it, and its words.

    It has no rules: they limit actions, not the meaning of an order. `repair` is why the `previous`
    answer was none.
    """
    text = link_names(world, mission.text)
    lines = ["Orders elsewhere"]
    lines += [line for order in nearest_orders(text, SHOWN) for line in _example(order)]
    lines += ["The order to read", mission_line(text)]
    if repair:
        lines.append(f"Previous answer: {previous}")
        lines += [f"Wrong: {' '.join(reason.split())}" for reason in repair]
    start = reading_prefix(world, digest)
    return Prompt(start.system, start.user + "\n".join(lines))


def reading_prefix(world: World, digest: Digest | None) -> Prompt:
    """Return the beginning of every such prompt while the picture stays as it is.

    Without a `digest`, that of a world too large to be told, it is what never changes.
    """
    if digest is None:
        return Prompt(READER, "")
    return Prompt(READER, "".join(f"{line}\n" for line in _there(world, digest)))


def _there(world: World, digest: Digest) -> Iterator[str]:
    """Yield what an order can be about: little more than names, as the clauses hold the rest."""
    told = told_frames(world, digest)
    yield f"Gates: {', '.join(name for name in told if world.frames[name].kind == 'gate')}"
    others = [name for name in told if world.frames[name].kind != "gate"]
    yield f"Places: {', '.join((*others, *world.zones))}"
    for kind in KINDS:
        names = [n for n in told_assets(world, digest) if world.assets[n].kind == kind]
        if names:
            yield f"{PLAIN_KINDS[kind].capitalize()}s: {', '.join(names)}"
    for track in tracks_of_digest(digest.tracks):
        yield f"{track.kind.capitalize()}: {track.id} at {track.gate}"


def _example(order: TaughtOrder) -> tuple[str, str]:
    return mission_line(order.text), json.dumps({"reason": f"{ASKED}{order.clauses}"})
