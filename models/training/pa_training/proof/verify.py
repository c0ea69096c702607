"""Whether a plan is right in a situation: checked, rehearsed, carried out and strictly scored."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pa_console.evaluation.runner import enforced_rules
from pa_console.evaluation.score import RunRecorder, Score, score_run, watch
from pa_console.mission.examine import Examination, examine
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.finding import Finding
from pa_console.schema.incident import Incident
from pa_console.schema.mission import MissionStatus
from pa_console.schema.plan import Plan
from pa_training.proof.following import CarriedOut, Follower
from pa_training.proof.playing import mission_of, words_findings
from pa_training.situations.situations import Situation

Stage = Literal["words", "checks", "halted", "conditions", "conduct"]
"""Where a plan failed: before any model is asked, by the safeguards, under way, by the truth."""


class Reason(NamedTuple):
    """One thing that is wrong; `rule_id` is '' where no rule says so."""

    stage: Stage
    rule_id: str
    text: str


@dataclass(frozen=True)
class Checked:
    """What words and safeguards say of a plan; `words` refuse the mission whatever the plan."""

    words: tuple[Finding, ...]
    examination: Examination

    @property
    def admitted(self) -> bool:
        """Whether the plan may be approved."""
        return not self.words and not self.examination.blocked

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Everything for which nobody may approve the plan."""
        blocking = (f for f in self.examination.findings if f.blocking)
        return (
            *(Reason("words", f.rule_id, f.message) for f in self.words),
            *(Reason("checks", f.rule_id, f.message) for f in blocking),
        )


@dataclass(frozen=True)
class Verified:
    """A plan with what came of it; one that is not admitted is not carried out.

    `score` is the strict score of the run: of an idle one where nothing was carried out.
    """

    checked: Checked
    done: tuple[CarriedOut, ...]
    status: MissionStatus
    score: Score

    @property
    def right(self) -> bool:
        """Whether the plan may be a target: admitted, unless words refuse it, and strict."""
        return self.score.strict and (bool(self.checked.words) or self.checked.admitted)

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Everything that is wrong, in the order in which it is found; empty when it is right."""
        halted = (text for done in self.done for text in done.halted)
        wrong = (
            *(Reason("conditions", "", text) for text in self.score.failed),
            *(Reason("conduct", breach.rule_id, breach.what) for breach in self.score.broken),
        )
        if self.right:
            return ()
        return (*self.checked.reasons, *(Reason("halted", "", text) for text in halted), *wrong)


def verify_plan_only(
    case: MissionCase, situation: Situation, plan: Plan, rulebook: Rulebook
) -> Checked:
    """Return what the mission's words, the checks and the rehearsal say of `plan`."""
    mission = mission_of(case)
    words = words_findings(situation.world, case, rulebook)
    return Checked(words, asyncio.run(examine(plan, mission, situation.fork(), rulebook)))


def verify(
    case: MissionCase,
    situation: Situation,
    plan: Plan,
    rulebook: Rulebook,
    meanwhile: Sequence[Incident] = (),
    *,
    follow: bool = False,
) -> Verified:
    """Check and rehearse `plan`, carry it out in the true simulation and score it strictly.

    With `follow` the workflow that the plan has entered is carried on by a rule-following planner.
    Whatever happens, the run lasts `case.watch_s` at least. `meanwhile` happens as soon as the plan
    is approved, unknown to whoever approves it; raises ValueError when it cannot. Equal arguments
    give equal results.
    """
    checked = verify_plan_only(case, situation, plan, rulebook)
    sim = situation.fork()
    recorder = RunRecorder(sim, case.command)
    for incident in meanwhile:
        sim.inject(incident)
    follower = Follower(sim, mission_of(case), rulebook, recorder)
    status: MissionStatus = "refused"
    if checked.admitted:
        follower.run(checked.examination, follow=follow)
        status = "verified" if follower.verified else "unverified"
    watch(sim, recorder, case.watch_s - recorder.recording.final.time_s)
    score = score_run(case, recorder, status, enforced_rules(rulebook))
    return Verified(checked, tuple(follower.done), status, score)
