"""Reading of orders with an untrained model, which states its reading in clauses.

The prompt has the forms of clauses, the picture, and the taught orders that are most similar to the
order. With these, a model reads far better than with a few fixed examples. The answer is the
beginning of a plan; the console adds the rest. A local model is constrained to the clauses that are
possible in the current picture. A model on a server cannot be constrained to them, so its answer is
checked afterwards, and discarded if it does not match.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import regex
from rapidfuzz import fuzz, process

from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.facts import shown_assets, shown_frames, tracks_of_digest
from pa_console.language.clause_grammar import grounded_asked
from pa_console.language.name_linking import link_names
from pa_console.llm.backend import Answerer, OnText, Request, ask_model, confidence
from pa_console.llm.roles.grammar import TEXT_SCHEMA, Schema, begun_grammar
from pa_console.llm.roles.judge import OrderReading
from pa_console.llm.roles.prompts import Prompt, mission_line
from pa_console.resources import data_folder
from pa_console.schema.document import DocumentError, read_text
from pa_console.schema.events.event import Role
from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import KINDS, PLAIN_KINDS, World

FILE = "taught_orders.tsv"
"""The file beside the model catalogue in which each line has an order, a tab, and its clauses."""
_NAME = re.compile(r"\b\w*(?:_\w|\d|[a-z][A-Z])\w*\b")
"""The form of names in a world, such as Drone_T04 and EastGate."""

SCHEMA: Schema = {
    "type": "object",
    "properties": {"reason": TEXT_SCHEMA},
    "required": ["reason"],
    "additionalProperties": False,
}
MAX_TOKENS = 160
"""The token limit of an answer; the context has room for it."""
SHOWN = 8
"""The number of taught orders in a prompt."""
DEADLINE_S = 60.0

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


class TaughtOrder(NamedTuple):
    """An order that uses the names of its own world, and its reading in clauses."""

    text: str
    clauses: str


def nearest_orders(text: str, count: int) -> list[TaughtOrder]:
    """Return the `count` taught orders whose words are most like those of `text`, the nearest last.

    All names count as equal, so an order is not more similar because it names the same asset or
    place. Raises DocumentError if the file is missing or broken.
    """
    orders, masked = taught_orders()
    matches = process.extract(
        without_names(text), masked, scorer=fuzz.token_set_ratio, limit=count, processor=None
    )
    return [orders[place] for _, _, place in reversed(matches)]


def without_names(text: str) -> str:
    """Return `text` in lower case, with every name replaced by the same mark."""
    return _NAME.sub("#", text).lower()


@cache
def taught_orders() -> tuple[Sequence[TaughtOrder], Sequence[str]]:
    """Return the taught orders, and their words without names; raises DocumentError."""
    path = data_folder() / "models" / FILE
    orders: list[TaughtOrder] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        text, tab, clauses = line.partition("\t")
        if not (text and tab and clauses):
            raise DocumentError(str(path), number, "", "write an order, a tab, and its clauses")
        orders.append(TaughtOrder(text, clauses))
    return orders, [without_names(order.text) for order in orders]


def reading_prompt(
    world: World,
    digest: Digest,
    _rules: Sequence[Rule],
    mission: Mission,
    repair: Sequence[str] = (),
    previous: str = "",
) -> Prompt:
    """Return the prompt for reading an order: clauses, picture, similar orders, and its words.

    The prompt has no rules, because rules limit actions but not the meaning of an order. `repair`
    lists the faults of the `previous` answer.
    """
    text = link_names(world, mission.text)
    lines = ["Orders elsewhere"]
    lines += [
        line
        for order in nearest_orders(text, SHOWN)
        for line in (mission_line(order.text), json.dumps({"reason": f"{ASKED}{order.clauses}"}))
    ]
    lines += ["The order to read", mission_line(text)]
    if repair:
        lines.append(f"Previous answer: {previous}")
        lines += [f"Wrong: {' '.join(reason.split())}" for reason in repair]
    start = reading_prefix(world, digest)
    return Prompt(start.system, start.user + "\n".join(lines))


def reading_prefix(world: World, digest: Digest | None) -> Prompt:
    """Return the beginning of every prompt for a reading while the picture does not change.

    If the world is too large for the prompt, there is no `digest`; the beginning is then the part
    that never changes.
    """
    if digest is None:
        return Prompt(READER, "")
    return Prompt(READER, "".join(f"{line}\n" for line in _there(world, digest)))


def _there(world: World, digest: Digest) -> Iterator[str]:
    """Yield the names that an order can use; the clauses explain all else."""
    frames = shown_frames(world, digest)
    yield f"Gates: {', '.join(name for name in frames if world.frames[name].kind == 'gate')}"
    others = [name for name in frames if world.frames[name].kind != "gate"]
    yield f"Places: {', '.join((*others, *world.zones))}"
    for kind in KINDS:
        names = [n for n in shown_assets(world, digest) if world.assets[n].kind == kind]
        if names:
            yield f"{PLAIN_KINDS[kind].capitalize()}s: {', '.join(names)}"
    for track in tracks_of_digest(digest.tracks):
        yield f"{track.kind.capitalize()}: {track.id} at {track.gate}"


@dataclass(frozen=True)
class ReadingQuestion:
    """A prompt for a reader; its answer matches each of the regular expressions `patterns`."""

    prompt: Prompt
    patterns: Sequence[str]
    """Regular expressions in Rust's syntax."""

    @property
    def grammar(self) -> str:
        """The grammar of the whole answer."""
        return begun_grammar(self.patterns)


def ask_what_is_asked(world: World, digest: Digest, mission: Mission) -> ReadingQuestion:
    """Return the prompt and grammar for the reading of `mission` in the picture of `digest`."""
    prompt = reading_prompt(world, digest, (), mission)
    return ReadingQuestion(prompt, grounded_asked(world, digest, mission.text))


class ClauseReader:
    """A reader of orders, with a model on this machine or a server, in the role `role`."""

    def __init__(
        self, engine: Answerer, role: Role = "judge", *, deadline_s: float = DEADLINE_S
    ) -> None:
        self._engine, self._deadline_s = engine, deadline_s
        self._role: Role = role

    @property
    def model(self) -> str:
        """The name of the model that answers."""
        return self._engine.name

    async def read(self, question: ReadingQuestion, on_text: OnText | None = None) -> OrderReading:
        """Return the reading of an order; it has an error unless it matches the patterns.

        `on_text` gets the answer in pieces. Never raises EngineError.
        """
        request = Request(
            self._role,
            question.prompt.system,
            question.prompt.user,
            question.grammar,
            MAX_TOKENS,
            self._deadline_s,
            schema=SCHEMA,
        )
        answer = await ask_model(self._engine, request, on_text)
        if answer.error:
            return OrderReading(
                "", answer.error, answer.usage, text=answer.text, fatal=answer.fatal
            )
        try:
            words = str(json.loads(answer.text)["reason"]).removeprefix(ASKED)
        except (ValueError, KeyError, TypeError):
            error = "its answer is not of the form asked for"
            return OrderReading("", error, answer.usage, text=answer.text)
        reading = f"{ASKED}{words}"
        if not all(
            regex.fullmatch(pattern, reading, flags=regex.V1) for pattern in question.patterns
        ):
            error = f"no reading in canonical clauses: {words[:120]}"
            return OrderReading("", error, answer.usage, text=answer.text)
        sure = confidence(answer.chances, answer.text, words)
        return OrderReading(reading, "", answer.usage, sure, answer.text)
