"""Orders that writers wrote for situations they were shown, each with what it means.

A writer sees a site, and no order, template or text of anybody else. The meaning is in the
canonical words of `language/canonical/clauses.py`; a second reader who saw only the orders wrote it
again, and where the two differ the order is left out. `language/written` is learnt,
`language/development` is kept aside: nothing is fitted on it.
"""

import random
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from pydantic import Field

from pa_console.language.canonical.clauses import ASKED, NOTHING
from pa_console.language.canonical.facts import conditions
from pa_console.language.canonical.order import Ask, Condition, in_words
from pa_console.language.canonical.reading import asked_words, parted, read_asked
from pa_console.language.clause_grammar import asked_now
from pa_console.language.name_linking import link_names
from pa_console.language.references.scene import PastMission
from pa_console.llm.roles.prompts import compact_planner_prompt, picture_prefix
from pa_console.mission.context import ordered_by
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.schema.mission import Mission
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World
from pa_training.order_generator.orders import Order
from pa_training.phrasing.no_orders import NOTHING_ASKED
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.samples.reading_samples import NO_TIME
from pa_training.samples.sample import Sample, make_sample
from pa_training.samples.selection import judge_readings, reading_of
from pa_training.situations.situations import Situation, carried_out, random_situation
from pa_training.situations.worlds import (
    Numbers,
    Split,
    generated_numbers,
    random_world,
    shipped_missions,
)
from pa_training.teacher.teacher import Target, teach

_SOME_FACT = "nothing to do"
_CONDITIONAL = re.compile(r"if (?P<condition>[^:]+): (?P<then>[^:]+), else: (?P<otherwise>[^:]+)")


class WrittenOrder(StrictModel):
    """One order in a writer's words, and its meaning in canonical words."""

    text: str
    meaning: str


class WrittenDialogue(StrictModel):
    """Orders that follow each other, each given after the one before was carried out."""

    turns: tuple[WrittenOrder, ...] = Field(min_length=1)


class WrittenSituation(StrictModel):
    """The draw of a situation, and what was written for it."""

    seed: int
    number: int
    split: Split
    history: bool = Field(default=True, description="whether something was ordered before")
    clock: str = Field(default="", description="the time of day that the writer saw, HH:MM")
    orders: tuple[WrittenOrder | WrittenDialogue, ...]

    @property
    def first_orders(self) -> tuple[WrittenOrder, ...]:
        """The orders that stand by themselves, and the first turn of each dialogue."""
        return tuple(
            order.turns[0] if isinstance(order, WrittenDialogue) else order for order in self.orders
        )


class Writer(StrictModel):
    """One writer's file."""

    writer: str = Field(description="who it was: the persona, in a sentence")
    situations: tuple[WrittenSituation, ...]


def read_writers(folder: Path) -> dict[str, Writer]:
    """Return the writers of `folder` by file name; raises DocumentError or OSError."""
    return {file.stem: Document.read(file).parse(Writer) for file in sorted(folder.glob("*.yaml"))}


def written_samples(name: str, writer: Writer) -> Iterator[Sample]:
    """Yield the samples of one writer, for planner and judge; only the reading is to be learnt.

    Texts too like a mission of a test set are dropped.
    """
    missions = shipped_missions()
    forbidden, known = generated_numbers(missions), NearDuplicates(missions)
    for place, each in enumerate(writer.situations, 1):
        situation = drawn_situation(each, forbidden)
        world = situation.world
        orders = each.first_orders
        fresh = known.keep([order.text for order in orders], world)
        for order, kept in zip(orders, fresh, strict=True):
            if kept:
                yield from _samples(f"written-{name}-{place}", f"written/{name}", order, situation)
        for number, order in enumerate(each.orders):
            if isinstance(order, WrittenDialogue):
                group = f"written-{name}-{place}-{number}"
                yield from _later_turns(group, f"written/{name}", order, situation)


def _samples(
    group: str, kind: str, order: WrittenOrder, situation: Situation, follows: str = ""
) -> Iterator[Sample]:
    """Yield what planner and judge are to read of an order, which `follows` other commands."""
    world, digest = situation.world, situation.digest
    meaning = meaning_now(corrected(order.meaning))
    if not meaning:
        return
    mission = Mission(id="M", text=order.text, created=NO_TIME, follows=follows)
    prompt = compact_planner_prompt(world, digest, [], mission)
    try:
        asked = asked_as_seen(meaning, world, digest)
    except ValueError:  # a condition about a place where sensors show nothing
        return
    fact = _fact(meaning, situation)
    ends = "" if meaning == NOTHING else f"; {fact or _SOME_FACT}"
    answer = f'{{"reason": "{asked}{ends}", "actions": []}}'
    picture = picture_prefix("planner", world, digest).user
    sample = make_sample(group, "planner", prompt, picture, answer, kind)
    read = reading_of(sample)
    if ends and not fact:
        read = read.model_copy(update={"answer": f'{{"reason": "{asked};'})
    yield read
    yield from judge_readings([sample])


def _later_turns(
    group: str, kind: str, dialogue: WrittenDialogue, situation: Situation
) -> Iterator[Sample]:
    """Yield the samples of the turns after the first, each once the one before was carried out.

    The teacher's plan stands for what was done. A turn that names assets which nobody has named
    and nobody moved is left out: its writer had another plan in mind.
    """
    follows, known = "", set[str]()
    for number, turn in enumerate(dialogue.turns):
        named = {name for name in situation.world.assets if _names(name, turn.meaning)}
        if number:
            linked = link_names(situation.world, turn.text)
            if not follows or not all(n in known or _names(n, linked) for n in named):
                return
            yield from _samples(f"{group}-{number}", kind, turn, situation, follows)
        known |= named
        if orders_nothing(turn.meaning):
            continue
        try:
            plan = ordered(meaning_now(corrected(turn.meaning)), situation).plan
        except (ValueError, LookupError):
            return
        moves = ordered_by(plan, situation.picture)
        situation = carried_out(situation, plan)
        known |= {move.agent for move in moves}
        follows = PastMission(turn.text, moves).commands


def _names(name: str, meaning: str) -> bool:
    return re.search(rf"\b{re.escape(name)}\b", meaning) is not None


def corrected(meaning: str) -> str:
    """Return the meaning of a correction without the sign that it is one."""
    return meaning.removeprefix("instead: ")


def drawn_situation(written: WrittenSituation, forbidden: Collection[Numbers]) -> Situation:
    """Return the situation that a writer was shown."""
    rng = random.Random(f"{written.seed}/{written.split}/{written.number}")
    world = random_world(rng, written.split, frozenset(forbidden))
    return random_situation(rng, world, history=written.history)


NO_ORDERS = ("nothing", "not now", "question", "standing order")
"""The meanings, alone instead of clauses, of words for which no asset moves now."""
FORBID = "forbid "
"""The beginning of the meaning of a prohibition."""
_BEYOND = re.compile(
    r"(undo|instead:|unclear:|at \d|in \d|every )|; then | for \d+ (min|h|s)\b| patrol "
)
"""Meanings that the clauses of a single plan cannot express."""


def orders_nothing(meaning: str) -> bool:
    """Return whether no asset moves now for this meaning."""
    return meaning in NO_ORDERS or meaning.startswith((FORBID, "unclear:"))


def meaning_now(meaning: str) -> str:
    """Return the meaning in the clauses that the planner reads; '' where they cannot express it.

    A question, a standing order and unclear words are answered before any planner reads them.
    """
    if meaning in {NOTHING, "not now"} or meaning.startswith(FORBID):
        return NOTHING
    if orders_nothing(meaning) or _BEYOND.search(meaning):
        return ""
    return meaning


def asked_as_seen(meaning: str, world: World, digest: Digest) -> str:
    """Return `meaning` as a reading begins, with the state of its condition.

    Raises ValueError for a condition that `digest` does not decide.
    """
    words, limits = parted(meaning.split("; "))
    if words == NOTHING:
        return f"{ASKED}{NOTHING_ASKED}"
    if _CONDITIONAL.fullmatch(words) is None:
        return f"{ASKED}{meaning}"
    open_ = "; ".join((f"{ASKED}{words}; now: open", *limits))
    asked = asked_now(world, digest, open_)
    if asked == open_:
        raise ValueError(f"{words}: the picture does not decide the condition")
    return asked


def _condition(words: str, world: World, digest: Digest) -> Condition:
    found = (each for each in conditions(world, digest) if in_words(each) == words)
    condition = next(found, None)
    if condition is None:
        raise ValueError(f"{words}: is no condition about the site")
    return condition


def _fact(meaning: str, situation: Situation) -> str:
    """Return the fact with which the teacher goes on; '' where it has no plan."""
    try:
        reason = ordered(meaning, situation).plan.reason
    except (ValueError, LookupError):
        return ""
    return reason.removeprefix(asked_words(reason))


def ordered(meaning: str, situation: Situation) -> Target:
    """Return what is right to do for `meaning`; raises ValueError or LookupError if nothing is."""
    world, picture, digest = situation.world, situation.picture, situation.digest
    words, _ = parted(meaning.split("; "))
    case = _CONDITIONAL.fullmatch(words)
    if case is not None:
        order = Order(
            _asks(case["then"]),
            _condition(case["condition"], world, digest),
            _asks(case["otherwise"]),
        )
        return teach(order, world, picture, digest)
    read = read_asked(f"{ASKED}{meaning}")
    if read is None or words == NOTHING:
        raise LookupError(meaning)
    order = Order(read.asks, others_stay=read.others_stay, excluded=read.excluded)
    return teach(order, world, picture, digest)


def _asks(clauses: str) -> tuple[Ask, ...]:
    read = None if clauses == NOTHING else read_asked(f"{ASKED}{clauses}")
    return () if read is None else read.asks
