"""Judge samples: right and wrong plans for missions, with verdicts that were found true."""

import json
import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from pa_console.llm.roles.grammar import MOST_VIOLATED, PLANNED
from pa_console.llm.roles.prompts import Prompt, compact_judge_prompt, picture_prefix
from pa_console.mission.examine import Examination
from pa_console.mission.judge import compare_with_order, judged_rules
from pa_console.mission.planning.moves import PlanMoves
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.plan import Action
from pa_console.schema.rule import Rule
from pa_training.order_generator.orders import canonical_order
from pa_training.phrasing.phrase_bank import Split
from pa_training.proof.playing import mission_of, words_findings
from pa_training.proof.verify import Verified, verify
from pa_training.samples.as_said import with_names_as_said
from pa_training.samples.corrupted_orders import swayed
from pa_training.samples.corrupted_plans import (
    Variant,
    right_variants,
    unsafe_variants,
    wrong_variants,
)
from pa_training.samples.judge_labels import Label, label_plan
from pa_training.samples.planner_samples import TOP_K, Group, Proven
from pa_training.samples.sample import Sample, make_sample
from pa_training.situations.situations import Situation

SWAYED = 0.12
"""How often the words of a mission carry text that speaks to the judge."""
UNSAFE = 0.15
"""How often a wrong plan is one that the safeguards are likely to block."""
BRIEF_S = 10.0
"""So long the run of a plan that should be wrong is watched at least, simulated seconds."""
TRIES = 3
"""Plans that are carried out for each one wanted, at most."""


def judge_samples(  # noqa: PLR0917
    group: Group,
    rulebook: Rulebook,
    retriever: Retriever,
    rng: random.Random,
    split: Split = "train",
    dropped: Counter[str] | None = None,
    reworded: Callable[[Proven], Proven | None] = lambda proven: proven,
) -> Iterator[Sample]:
    """Yield samples of about as many right plans as wrong ones for every mission of `group`.

    Missions that their words alone refuse, and plans that the safeguards block, are left out: they
    are never judged. `dropped` counts why plans were not taken. Each plan stands under words of its
    own where `reworded` has some. Equal states of `rng` give equal samples.
    """
    situation = group.situation
    picture = picture_prefix("judge", situation.world, situation.digest).user
    for proven in group.proven:
        if words_findings(situation.world, proven.case, rulebook):
            continue
        words = canonical_order(proven.order, situation.world, situation.picture, situation.digest)
        for variant, verified, label in _labelled(proven, group, rulebook, rng, dropped):
            found = verified.checked.examination
            if found.rehearsal is None or found.blocked:
                continue
            told = _told(reworded(proven) or proven, situation, rulebook, rng, split)
            hits = retriever.retrieve(told.case.command, TOP_K)
            rules = [rulebook.get(rule_id) for rule_id in judged_rules(hits, found.findings)]
            prompt = _prompt(told.case, situation, rules, found)
            plan = PlanMoves(situation.world, found.rehearsal.before, found.plan)
            compared = compare_with_order(f"asked: {words}", plan)
            if label.right and compared.gaps:
                continue
            said = label._replace(feedback=f"asked: {words}{PLANNED}{compared.told}")
            answer = answer_of(said, [rule.id for rule in rules])
            kind = f"{told.kind.partition('/')[0]}/{variant.how}/{verdict_word(label.right)}"
            sample = make_sample(group.name, "judge", prompt, picture, answer, kind, compared.told)
            yield with_names_as_said(sample, told.order)


def answer_of(label: Label, rule_ids: Sequence[str]) -> str:
    """Return `label` as the judge is to write it; only `rule_ids` can be named as violated."""
    violated = [rule_id for rule_id in label.violated if rule_id in rule_ids][:MOST_VIOLATED]
    verdict = verdict_word(label.right)
    return json.dumps({"feedback": label.feedback, "violated": violated, "verdict": verdict})


def verdict_word(right: bool) -> str:
    """Return the verdict as the judge writes it."""
    return "Success" if right else "Failure"


def _prompt(
    case: MissionCase, situation: Situation, rules: Sequence[Rule], found: Examination
) -> Prompt:
    assert found.rehearsal is not None
    return compact_judge_prompt(
        situation.world, situation.digest, rules, mission_of(case), found.plan, found.rehearsal
    )


def _told(
    proven: Proven, situation: Situation, rulebook: Rulebook, rng: random.Random, split: Split
) -> Proven:
    """Return the mission, now and then with words that want to sway the judge."""
    if rng.random() >= SWAYED:
        return proven
    text = swayed(proven.case.command, rng, split)
    case = proven.case.model_copy(update={"command": text})
    if words_findings(situation.world, case, rulebook):
        return proven
    return replace(proven, case=case, kind=f"swayed/{proven.kind}")


def _labelled(
    proven: Proven,
    group: Group,
    rulebook: Rulebook,
    rng: random.Random,
    dropped: Counter[str] | None,
) -> Iterator[tuple[Variant, Verified, Label]]:
    """Yield plans with their labels: the proven one, another right one if any, and wrong ones."""
    situation = group.situation
    counts = {True: 0, False: 0}
    wanted = {True: rng.choice((1, 2, 2)), False: 2}
    target = Variant(proven.plan, "right", "target")
    seen: set[tuple[Action, ...]] = set()
    for right, pool in (
        (True, [target, *right_variants(proven, situation, rng)]),
        (False, _wrong_pool(proven, group, rng)),
    ):
        fresh = [variant for variant in pool if variant.plan.actions not in seen]
        for variant in fresh[: TRIES * wanted[right]]:
            if counts[right] >= wanted[right]:
                break
            seen.add(variant.plan.actions)
            verified = _verified(proven, situation, variant, rulebook)
            label = label_plan(proven, situation, variant.plan, verified)
            if isinstance(label, Label):
                counts[label.right] += 1
                yield variant, verified, label
            elif dropped is not None:
                dropped[f"{variant.how}: {label.why}"] += 1


def _wrong_pool(proven: Proven, group: Group, rng: random.Random) -> list[Variant]:
    """Return wrong plans in the order in which they are tried, some of them unsafe ones."""
    wrong = wrong_variants(proven, group.proven, group.situation, rng)
    unsafe = unsafe_variants(proven, group.situation, rng)
    pool: list[Variant] = []
    while wrong or unsafe:
        pick = unsafe if unsafe and (not wrong or rng.random() < UNSAFE) else wrong
        pool.append(pick.pop(0))
    return pool


def _verified(
    proven: Proven, situation: Situation, variant: Variant, rulebook: Rulebook
) -> Verified:
    """Carry a plan out, unless that was done for these very words.

    What is wrong soon after the plan has ended stays wrong, so only right runs are watched in full.
    """
    case, follow = proven.case, proven.target.follow
    if variant.plan == proven.plan and proven.verified.checked.examination.plan == proven.plan:
        return proven.verified
    if variant.hope != "right":
        brief = case.model_copy(update={"watch_s": min(BRIEF_S, case.watch_s)})
        verified = verify(brief, situation, variant.plan, rulebook, follow=follow)
        if not verified.score.strict or verified.checked.examination.blocked:
            return verified
    return verify(case, situation, variant.plan, rulebook, follow=follow)
