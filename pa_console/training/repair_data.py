"""Repair samples: an answer that was sent back with what is wrong about it, and the right one."""

import random
from collections.abc import Iterator, Sequence

from pa_console.llm.compact_prompt import ahead
from pa_console.llm.reading import read_reason
from pa_console.orchestrator.fulfilment import gaps
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.plan import Plan
from pa_console.training.corruptions import REASON, Variant, unsafe_variants, wrong_variants
from pa_console.training.planner_data import Group, Proven, planner_prompt_of
from pa_console.training.samples import Sample, make_sample
from pa_console.training.situations import Situation
from pa_console.training.verify import verify_plan_only

SHARE = 0.5
"""How many of the missions are told with an answer that was sent back, where one is found."""
OTHER_FACTS = 0.5
"""How often such an answer also gives facts that decide something else."""
TRIES = 4
"""Answers that are examined for each one wanted, at most."""
_END = "; "


def repair_samples(
    group: Group, rulebook: Rulebook, retriever: Retriever, rng: random.Random
) -> Iterator[Sample]:
    """Yield the missions of `group` once more, each after an answer with its faults.

    Equal states of `rng` give equal samples.
    """
    situation = group.situation
    picture = ahead("planner", situation.world, situation.digest).user
    for proven in group.proven:
        if rng.random() >= SHARE:
            continue
        answers = _answers(proven, group, rng)
        examined = ((plan, faults_of(proven, plan, situation, rulebook)) for plan in answers)
        sent_back = next(((plan, faults) for plan, faults in examined if faults), None)
        if sent_back is None:
            continue
        previous, faults = sent_back[0].answer, sent_back[1]
        case = proven.case
        prompt = planner_prompt_of(case, situation, rulebook, retriever, faults, previous)
        kind = f"repair/{proven.kind.partition('/')[0]}"
        yield make_sample(group.name, "planner", prompt, picture, proven.plan.answer, kind)


def faults_of(
    proven: Proven, plan: Plan, situation: Situation, rulebook: Rulebook
) -> tuple[str, ...]:
    """Return for what the console sends `plan` back: rules it breaks, else what is not as asked.

    Empty where it would not, and where the words of the mission are refused whatever the plan.
    """
    checked = verify_plan_only(proven.case, situation, plan, rulebook)
    found, reading = checked.examination, read_reason(plan.reason)
    if checked.words or found.blocked:
        return () if checked.words else found.faults
    if reading is None or not reading.readable or found.rehearsal is None:
        return ()
    return gaps(PlanMoves(situation.world, found.rehearsal.before, plan), reading)


def _answers(proven: Proven, group: Group, rng: random.Random) -> Iterator[Plan]:
    """Yield answers to `proven` that are likely to be sent back: misread, or read well and wrong.

    An edited plan keeps what was asked; its facts may be those of another mission.
    """
    situation = group.situation
    pool: Sequence[Variant] = [
        *wrong_variants(proven, (), situation, rng),
        *unsafe_variants(proven, situation, rng),
    ]
    for variant in rng.sample(pool, min(TRIES, len(pool))):
        plan = variant.plan
        if plan.reason == REASON:
            plan = plan.model_copy(update={"reason": _reason(proven, group, rng)})
        yield plan


def _reason(proven: Proven, group: Group, rng: random.Random) -> str:
    """Return what was asked with the facts that decide, or with those of another mission."""
    reason, other = proven.plan.reason, rng.choice(group.proven).plan.reason
    asked, facts = reason.rpartition(_END)[::2]
    if asked and rng.random() < OTHER_FACTS:
        facts = other.rpartition(_END)[2] if _END in other else facts
    return f"{asked}{_END}{facts}" if asked else reason
