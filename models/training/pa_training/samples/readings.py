"""Samples that are only to be read: of the answer, no more is learnt than what was asked.

What a planner gets wrong is mostly what was meant, and proving a plan costs a hundred times as much
as reading an order. The teacher's first plan says which fact comes after the reading.
"""

import random
from collections.abc import Iterable, Iterator

from pa_console.language.canonical.clauses import NOTHING
from pa_console.language.canonical.reading import asked_words
from pa_console.language.name_linking import link_names
from pa_console.language.references.scene import PastMission
from pa_console.llm.roles.compact_prompts import (
    TASKS,
    compact_planner_prompt,
    picture_prefix,
)
from pa_console.llm.roles.grammar import PLANNED
from pa_console.mission.context import ordered_by
from pa_training.orders.meaning import (
    NOTHING_ASKED,
    asked_as_seen,
    corrected,
    meaning_now,
    names_asset,
    order_of,
    orders_nothing,
)
from pa_training.orders.near_duplicates import shipped_duplicates
from pa_training.orders.no_orders import draw_text, shipped_lists
from pa_training.orders.written import WrittenDialogue, WrittenOrder, WrittenSituation
from pa_training.proof.playing import mission_from
from pa_training.samples.sample import Sample, make_sample
from pa_training.situations.situations import Situation, carried_out
from pa_training.teacher.teacher import teach

ASKING_NOTHING = 3
"""Texts that ask for nothing in each situation, beside those of its writer."""
_SOME_FACT = "nothing to do"
_REASON, _FEEDBACK = '{"reason": "', '{"feedback": "'
_BEFORE, _MISSION = "\nBefore: ", "\nMission: "


def written_readings(
    name: str, written: WrittenSituation, situation: Situation
) -> Iterator[Sample]:
    """Yield what planner and judge are to read of everything that was written for a situation.

    Texts too like a mission of a test set are dropped.
    """
    orders = written.first_orders
    fresh = shipped_duplicates().keep([order.text for order in orders], situation.world)
    for order, kept in zip(orders, fresh, strict=True):
        if kept:
            yield from _readings(name, order, situation)
    for number, order in enumerate(written.orders):
        if isinstance(order, WrittenDialogue):
            yield from _later_turns(f"{name}-{number}", order, situation)
    rng = random.Random(f"nothing/{name}")
    for _ in range(ASKING_NOTHING):
        text, kind = draw_text(rng, situation.world, shipped_lists())
        order = WrittenOrder(text=text, meaning=NOTHING)
        yield from _readings(name, order, situation, f"nothing/{kind}")


def _readings(
    group: str,
    order: WrittenOrder,
    situation: Situation,
    kind: str = "reading",
    follows: str = "",
) -> Iterator[Sample]:
    """Yield what planner and judge are to read of an order, which `follows` other commands."""
    world, digest = situation.world, situation.digest
    meaning = meaning_now(corrected(order.meaning))
    if not meaning:
        return
    mission = mission_from(order.text).model_copy(update={"follows": follows})
    prompt = compact_planner_prompt(world, digest, [], mission)
    try:
        asked = asked_as_seen(meaning, world, digest)
    except ValueError:  # a condition about a place where sensors show nothing
        return
    fact = _fact(meaning, situation)
    ends = "" if asked.endswith(NOTHING_ASKED) else f"; {fact or _SOME_FACT}"
    answer = f'{{"reason": "{asked}{ends}", "actions": []}}'
    picture = picture_prefix("planner", world, digest).user
    sample = make_sample(group, "planner", prompt, picture, answer, kind)
    read = reading_of(sample)
    if ends and not fact:
        read = read.model_copy(update={"answer": f'{{"reason": "{asked};'})
    yield read
    yield from judge_readings([sample])


def _fact(meaning: str, situation: Situation) -> str:
    """Return the fact with which the teacher goes on; '' where it has no plan."""
    try:
        order = order_of(meaning, situation.world, situation.digest)
        target = teach(order, situation.world, situation.picture, situation.digest)
    except (ValueError, LookupError):
        return ""
    return target.plan.reason.removeprefix(f"{order.asked}; ")


def _later_turns(group: str, dialogue: WrittenDialogue, situation: Situation) -> Iterator[Sample]:
    """Yield the samples of the turns after the first, each once the one before was carried out.

    The teacher's plan stands for what was done. A turn that names assets which nobody has named
    and nobody moved is left out: its writer had another plan in mind.
    """
    follows, known = "", set[str]()
    for number, turn in enumerate(dialogue.turns):
        world = situation.world
        named = {name for name in world.assets if names_asset(turn.meaning, name)}
        if number:
            linked = link_names(world, turn.text)
            if not follows or not all(n in known or names_asset(linked, n) for n in named):
                return
            yield from _readings(f"{group}-{number}", turn, situation, "later turn", follows)
        known |= named
        if orders_nothing(turn.meaning):
            continue
        try:
            order = order_of(meaning_now(corrected(turn.meaning)), world, situation.digest)
            plan = teach(order, world, situation.picture, situation.digest).plan
        except (ValueError, LookupError):
            return
        moves = ordered_by(plan, situation.picture)
        situation = carried_out(situation, plan)
        known |= {move.agent for move in moves}
        follows = PastMission(turn.text, moves).commands


def readings(samples: Iterable[Sample], share: float, seed: int) -> Iterator[Sample]:
    """Yield `samples`, those of a `share` (0 to 1) of the groups cut down to their readings."""
    for sample in samples:
        drawn = random.Random(f"readings/{seed}/{sample.group}").random() < share
        yield reading_of(sample) if drawn and sample.task == "planner" else sample


def reading_of(sample: Sample) -> Sample:
    """Return `sample` without its rules and with its answer up to the first word after the reading.

    That word tells that nothing more was asked. A sample whose reason has no reading stays whole.
    """
    asked = _asked(sample)
    if not asked:
        return sample
    return _begun(sample, sample.answer[: sample.answer.find(" ", len(_REASON) + len(asked))])


def judge_readings(samples: Iterable[Sample]) -> Iterator[Sample]:
    """Yield what the judge is to read of the missions of planner `samples`, where they tell it.

    Its answer begins with the same words, and goes on with what was planned.
    """
    for sample in samples:
        asked = _asked(sample).removesuffix("; ")
        if asked:
            begun = _begun(sample, f"{_FEEDBACK}{asked}{PLANNED.rstrip(': ')}")
            system = begun.system.replace(TASKS["planner"], TASKS["judge"], 1)
            yield begun.model_copy(update={"system": system, "task": "judge"})


def _asked(sample: Sample) -> str:
    """Return how the reason of a planner's sample begins, '' where that is no reading."""
    return asked_words(sample.answer.removeprefix(_REASON).partition('", "actions"')[0])


def _begun(sample: Sample, answer: str) -> Sample:
    """Return `sample` without its rules, with only the beginning of an answer."""
    held, said, mission = f"\n{sample.rest}".partition(_MISSION)
    _, before, commands = held.partition(_BEFORE)
    words = "".join((before, commands, said)).lstrip() + mission
    return sample.model_copy(update={"rest": words, "answer": answer, "goes_on": True})
