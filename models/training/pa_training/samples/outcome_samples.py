"""Outcome samples: plans that were carried out, what telemetry shows, and whether it was success.

The verdict is the strict truth of the run. Runs of which telemetry cannot tell it are left out.
"""

import random
from collections import Counter
from collections.abc import Iterator

from pa_console.llm.roles.prompts import compact_outcome_prompt, compact_picture
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.mission import Verification
from pa_training.order_generator.orders import due_asks
from pa_training.proof.following import CarriedOut
from pa_training.proof.verify import Verified, verify
from pa_training.samples.corrupted_plans import Variant, right_variants, wrong_variants
from pa_training.samples.judge_labels import (
    Label,
    Unclear,
    feedback,
    moves,
    readable,
    why_right,
    why_wrong,
)
from pa_training.samples.judge_samples import answer_of, verdict_word
from pa_training.samples.planner_samples import Group, Proven
from pa_training.samples.sample import Sample, make_sample
from pa_training.situations.later_incidents import draw_later_incidents
from pa_training.situations.situations import Situation

RIGHT, WRONG = 0.35, 0.7
"""Up to the first, a mission is shown carried out well; up to the second, wrongly planned."""
TRIES = 3
"""Runs that are tried for one sample at most."""
BRIEF_S = 10.0
"""So long the run of a wrong plan is watched at least, simulated seconds."""


def outcome_samples(
    group: Group, rulebook: Rulebook, rng: random.Random, dropped: Counter[str] | None = None
) -> Iterator[Sample]:
    """Yield about one sample for every mission of `group`; equal states of `rng` give equal ones.

    `dropped` counts why runs were not taken. Every sample is a group of its own, as every run ends
    in another picture.
    """
    for number, proven in enumerate(group.proven):
        if proven.verified.checked.words:
            continue
        for variant, verified in _runs(proven, group, rulebook, rng):
            label = label_outcome(proven, group.situation, verified)
            if isinstance(label, Label):
                name = f"{group.name}-outcome{number}"
                yield _sample(name, proven, group.situation, variant, verified.done[0], label)
                break
            if dropped is not None:
                dropped[f"outcome {variant.how}: {label.why}"] += 1


def label_outcome(proven: Proven, situation: Situation, verified: Verified) -> Label | Unclear:
    """Return what the judge is to say of the first plan that was carried out in a run."""
    if not verified.done or verified.done[0].verification is None:
        return Unclear("nothing was carried out to its end")
    done, strict = verified.done[0], verified.score.strict
    verification, plan = done.verification, done.plan
    assert verification is not None
    if due_asks(proven.order, situation.picture) != due_asks(proven.order, done.picture):
        return Unclear("its condition has changed")
    fits, differs = why_right(proven, situation, plan), why_wrong(proven, situation, plan)
    if strict and fits and verification.outcome == "pass":
        why = f"{fits}; done"
    elif not strict and differs and not fits:
        why = differs
    elif not strict and fits and verification.outcome != "pass":
        why = f"{fits}; {_trouble(verification)}"
    else:
        return Unclear(f"strict {strict}, telemetry {verification.outcome}")
    text = feedback(proven, situation, plan, why)
    return Label(strict, text, ()) if readable(text) else Unclear("too long")


def _trouble(verification: Verification) -> str:
    """Return in short what telemetry has against the outcome."""
    if verification.gates_lost:
        return f"{verification.gates_lost[0]} lost its cover"
    for outcome, words in (("fail", "did not do it"), ("unknown", "is not known to have done it")):
        for action in verification.actions:
            if action.outcome == outcome:
                return f"{action.agent} {words}"
    if verification.gates_unknown:
        return f"cover of {verification.gates_unknown[0]} is unknown"
    return "not done"


def _runs(
    proven: Proven, group: Group, rulebook: Rulebook, rng: random.Random
) -> Iterator[tuple[Variant, Verified]]:
    """Yield runs of one sort for a mission until one of them will do."""
    situation, drawn = group.situation, rng.random()
    target = Variant(proven.plan, "right", "target")
    follow = proven.target.follow
    if drawn < RIGHT:
        yield target, proven.verified
        for variant in right_variants(proven, situation, rng)[:TRIES]:
            yield variant, verify(proven.case, situation, variant.plan, rulebook, follow=follow)
    elif drawn < WRONG or not moves(proven.plan):
        case = proven.case.model_copy(update={"watch_s": BRIEF_S})
        for variant in wrong_variants(proven, group.proven, situation, rng)[:TRIES]:
            yield variant, verify(case, situation, variant.plan, rulebook, follow=follow)
    else:
        plan = proven.plan
        for incident in draw_later_incidents(plan, situation.world, situation.picture, rng)[:TRIES]:
            try:
                verified = verify(
                    proven.case, situation, plan, rulebook, (incident,), follow=follow
                )
            except ValueError:  # an asset stands where something would lie across the way
                continue
            yield Variant(plan, "wrong", f"mishap {incident.kind}"), verified


def _sample(  # noqa: PLR0917
    name: str,
    proven: Proven,
    situation: Situation,
    variant: Variant,
    done: CarriedOut,
    label: Label,
) -> Sample:
    assert done.verification is not None
    digest = digest_picture(done.picture, situation.world)
    prompt = compact_outcome_prompt(
        situation.world, digest, done.task, done.plan, done.verification
    )
    kind = f"{proven.kind.partition('/')[0]}/{variant.how}/{verdict_word(label.right)}"
    picture = compact_picture(situation.world, digest)
    return make_sample(name, "outcome", prompt, picture, answer_of(label, ()), kind)
