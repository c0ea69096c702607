"""Outcome samples: plans that were carried out, what telemetry shows, and whether it was success.

The verdict is the strict truth of the run. Runs of which telemetry cannot tell it are left out.
"""

import random
from collections.abc import Iterator

from pa_console.language.canonical.reading import read_asked
from pa_console.language.clause_grammar import asked_now
from pa_console.llm.roles.compact_prompts import (
    compact_outcome_prompt,
    compact_picture,
)
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import STILL
from pa_console.schema.mission import Verification
from pa_training.proof.following import CarriedOut
from pa_training.proof.verify import Verified, verify
from pa_training.samples.corrupted_plans import Variant, right_variants, wrong_variants
from pa_training.samples.groups import Group, Proven
from pa_training.samples.judge_samples import BRIEF_S, TRIES, Label, compared
from pa_training.samples.sample import Sample, make_sample
from pa_training.situations.later_incidents import draw_later_incidents
from pa_training.situations.situations import Situation

RIGHT, WRONG = 0.35, 0.7
"""Up to the first, a mission is shown carried out well; up to the second, wrongly planned."""


def outcome_samples(group: Group, rulebook: Rulebook, rng: random.Random) -> Iterator[Sample]:
    """Yield about one sample for every mission of `group`; equal states of `rng` give equal ones.

    Every sample is a group of its own, as every run ends in another picture.
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
            group.dropped[f"outcome {variant.how}: {label}"] += 1


def label_outcome(proven: Proven, situation: Situation, verified: Verified) -> Label | str:
    """Return the judge's words on the first plan of a run, or why they are unclear."""
    if not verified.done or verified.done[0].verification is None:
        return "nothing was carried out to its end"
    done, strict = verified.done[0], verified.score.strict
    verification = done.verification
    assert verification is not None
    later = digest_picture(done.picture, situation.world)
    if read_asked(asked_now(situation.world, later, proven.order.asked)) != proven.order.reading:
        return "its condition has changed"
    looks = compared(proven, situation, situation.picture, done.plan)
    told = looks.told
    if strict and looks.fits and verification.outcome == "pass":
        told = f"{told}; done"
    elif not strict and looks.fits and verification.outcome != "pass":
        told = f"{told}; {_trouble(verification)}"
    elif strict or looks.fits:
        return f"strict {strict}, telemetry {verification.outcome}"
    return Label(strict, f"{looks.asked}{told}", looks.told)


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
    situation, case, plan = group.situation, proven.case, proven.plan
    follow, drawn = proven.target.follow, rng.random()
    if drawn < RIGHT:
        yield Variant(plan, "right", "target"), proven.verified
        for variant in right_variants(proven, situation, rng)[:TRIES]:
            yield variant, verify(case, situation, variant.plan, rulebook, follow=follow)
    elif drawn < WRONG or all(action.verb in STILL for action in plan.actions):
        brief = case.model_copy(update={"watch_s": BRIEF_S})
        for variant in wrong_variants(proven, group.proven, situation, rng)[:TRIES]:
            yield variant, verify(brief, situation, variant.plan, rulebook, follow=follow)
    else:
        for incident in draw_later_incidents(plan, situation.world, situation.picture, rng)[:TRIES]:
            try:
                verified = verify(case, situation, plan, rulebook, (incident,), follow=follow)
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
    kind = f"{proven.kind}/{variant.how}/{label.verdict}"
    picture = compact_picture(situation.world, digest)
    return make_sample(name, "outcome", prompt, picture, label.answer(), kind, label.given)
