"""The trace of one mission: its state and each of its plans."""

import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import cast

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, FindingStatus, Usage, Verdict
from pa_console.schema.mission import (
    ApprovalState,
    Decision,
    Metrics,
    Mission,
    MissionStatus,
    Verification,
)
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Priority, RuleHit
from pa_console.schema.telemetry import Digest
from pa_console.session.confidence import UNSURE, Evidence, calibrated_confidence


@lru_cache(maxsize=16)
def _unpacked(stored: bytes) -> Rehearsal:
    return Rehearsal.model_validate_json(zlib.decompress(stored))


class _PackedRehearsal:
    """The rehearsal of an attempt, which `Attempt.pack` compresses."""

    def __get__(self, attempt: object, _: type | None = None) -> Rehearsal | None:
        stored = vars(attempt).get("rehearsal") if attempt is not None else None
        return _unpacked(stored) if isinstance(stored, bytes) else stored

    def __set__(self, attempt: object, rehearsal: Rehearsal | None) -> None:
        vars(attempt)["rehearsal"] = rehearsal


@dataclass
class Attempt:
    """One plan with its prompt, answer, findings, rehearsal and verdict.

    `round` is the number of earlier plans of the mission. `phase` is the phase of the workflow that
    the plan is for, or ''. `digest` is the picture from which the plan was made.
    """

    number: int
    round: int = 0
    phase: str = ""
    step: str = ""
    """The step of the order that the plan is for; '' for the whole order."""
    digest: Digest | None = None
    author: str = "planner"
    system: str = ""
    user: str = ""
    text: str = ""
    plan: Plan | None = None
    error: str = ""
    usage: Usage = field(default_factory=Usage)
    confidence: float | None = None
    """The planner's confidence in its reading of the order."""
    findings: tuple[Finding, ...] = ()
    checks_s: float = 0.0
    unmet: tuple[str, ...] = ()
    """The parts of the order that the plan leaves out, each with its reason."""
    gaps: tuple[str, ...] = ()
    """The mismatches between the words of the order and the reading that the plan is for."""
    rehearsal: Rehearsal | None = cast("Rehearsal | None", _PackedRehearsal())  # noqa: RUF009
    """The last rehearsal of the plan; None if it was not rehearsed."""
    rehearsal_s: float = 0.0
    if_halted: tuple[Action, ...] = ()
    """The way to safety that was declared with the request for approval."""
    judge_text: str = ""
    verdict: Verdict | None = None
    judged: bool = False
    judge_error: str = ""
    judge_usage: Usage = field(default_factory=Usage)
    judge_confidence: float | None = None
    repair: tuple[str, ...] = ()
    instead_of: int | None = None
    """The attempt whose prompt this plan also answers; None for a prompt of its own."""
    given: bool = False
    """True if the console gave the commands and the planner only chose the assets."""
    as_judged: bool = False
    """True if the plan is for the judge's reading of the order, not the planner's."""
    as_read_again: bool = False
    """True if the plan is for the second reader's reading of the order."""
    read_again: ev.OrderReadAgain | None = None
    """The second reader's answer; None if the second reader was not asked."""
    shown_confidence: float | None = None
    """The confidence in the reading that was shown to the operator."""
    server: str = ""
    """The model on a server that wrote the plan; '' for the local model."""
    as_chosen: bool = False
    """True if the plan is for the reading that the operator chose."""
    made_s: float | None = None
    """The time of the first rehearsal, in simulated seconds; `rehearsal` is the latest one."""

    def pack(self) -> None:
        """Reduce the memory of a finished mission: compress the rehearsal, share equal findings."""
        if self.rehearsal is not None:
            text = self.rehearsal.model_dump_json()
            vars(self)["rehearsal"] = zlib.compress(text.encode())
        self.findings = tuple(
            _shared(finding.rule_id, finding.priority, finding.status, finding.message)
            for finding in self.findings
        )

    @property
    def sure(self) -> float | None:
        """The confidence, from 0 to 1, that the order was read correctly, as shown to the operator.

        Before approval is requested, it is computed from the confidences of planner and judge.
        """
        if self.shown_confidence is not None:
            return self.shown_confidence
        return calibrated_confidence(
            Evidence(self.confidence, self.judge_confidence, gaps=len(self.gaps))
        )

    @property
    def doubt(self) -> str:
        """A warning that the order may have been misread; '' for a confident reading."""
        why = list(self.gaps)
        if self.sure is not None and self.sure < UNSURE:
            why.append(f"read with {self.sure:.0%} confidence")
        return f"the order may mean something else: {'; '.join(why)}" if why else ""

    @property
    def aside(self) -> str:
        """The replaced attempt and the `origin`, as shown after the plan's number and author."""
        instead = "" if self.instead_of is None else f", instead of {self.instead_of}"
        return instead + self.origin

    @property
    def origin(self) -> str:
        """The other contributors, in words that continue a sentence; '' if there are none."""
        given = ", its commands given by the console" * self.given
        judged = ", as the judge read it" * self.as_judged
        judged += ", as the second reader read it" * self.as_read_again
        served = f", by {self.server}" if self.server else ""
        return served + given + judged + ", as the operator meant it" * self.as_chosen


@lru_cache(maxsize=1024)
def _shared(rule_id: str, priority: Priority, status: FindingStatus, message: str) -> Finding:
    """Return a finding, the same object for the same values."""
    return Finding(rule_id=rule_id, priority=priority, status=status, message=message)


@dataclass
class CommandTrace:
    """A dispatched command, its replies (oldest first), and the number of resends."""

    command: DeviceCommand
    replies: list[CommandReply] = field(default_factory=list[CommandReply])
    resent: int = 0
    round: int = 0


@dataclass
class VerifiedPlan:
    """The verification of one executed plan by telemetry, and the judge's verdict on it."""

    verification: Verification
    round: int = 0
    attempt: int = 0
    step: int = 0
    """The number of the plan's step, from 1; 0 for a plan of one step."""
    judged: bool = False
    verdict: Verdict | None = None
    error: str = ""
    judging_s: float = 0.0


@dataclass
class MissionTrace:
    """The state of one mission; `stage` is its present stage.

    `rules` is the content hash of the rule set that the mission uses.
    """

    mission: Mission
    stage: str = "queued"
    rules: str = ""
    method: str = ""
    hits: tuple[RuleHit, ...] = ()
    retrieval_s: float = 0.0
    digest: Digest | None = None
    attempts: list[Attempt] = field(default_factory=list[Attempt])
    round: int = 0
    executing: int = 0
    workflow: list[ev.WorkflowMoved] = field(default_factory=list[ev.WorkflowMoved])
    approval: ev.ApprovalRequested | None = None
    offered: tuple[str, ...] = ()
    """The other readings that were offered with the last plan."""
    approval_state: ApprovalState | None = None
    """The state of the last request for approval."""
    stills: dict[int, ev.CameraStill] = field(default_factory=dict[int, ev.CameraStill])
    """The last still that was shown with each plan, by attempt number."""
    decisions: list[ev.DecisionMade] = field(default_factory=list[ev.DecisionMade])
    questions: list[ev.QuestionAsked] = field(default_factory=list[ev.QuestionAsked])
    """The questions to the operator about the order."""
    answers: list[ev.QuestionAnswered] = field(default_factory=list[ev.QuestionAnswered])
    """The answers to the operator's questions about the mission."""
    step: str = ""
    """The step of the order that is being planned; '' for the whole order."""
    references: tuple[ev.Reference, ...] = ()
    """The words of the order that refer to something, with their meanings."""
    standing: ev.StandingOrderRead | None = None
    """The standing order that the text gives, as it was read; None for a mission."""
    voided: str = ""
    voided_attempt: int = 0
    """The number of the plan that became void; `voided` is the reason."""
    preempted: str = ""
    commands: dict[str, CommandTrace] = field(default_factory=dict[str, CommandTrace])
    halts: list[ev.PlanHalted] = field(default_factory=list[ev.PlanHalted])
    held: list[ev.StepsHeld] = field(default_factory=list[ev.StepsHeld])
    """The events that name unsent actions of plans in steps, with the reasons."""
    verified: list[VerifiedPlan] = field(default_factory=list[VerifiedPlan])
    unasked_verdict: Verdict | None = None
    unasked_error: str = ""
    report: str = ""
    status: MissionStatus | None = None
    reason: str = ""
    metrics: Metrics | None = None

    def find(self, number: int) -> Attempt | None:
        """Return attempt `number`, or None if there is none."""
        return next((a for a in reversed(self.attempts) if a.number == number), None)

    def attempt(self, number: int) -> Attempt:
        """Return attempt `number`, from 1, which is added if it is new."""
        attempt = self.find(number)
        if attempt is None:
            attempt = Attempt(
                number, round=self.round, phase=self.phase, step=self.step, digest=self.digest
            )
            self.attempts.append(attempt)
        return attempt

    def find_verified(self, number: int | None) -> VerifiedPlan | None:
        """Return the verification of attempt `number`, or the last one if `number` is None."""
        matches = (v for v in reversed(self.verified) if number is None or v.attempt == number)
        return next(matches, None)

    def next_round(self) -> None:
        """Begin the next round, to which later attempts belong."""
        if self.attempts and self.attempts[-1].round == self.round:
            self.round += 1

    @property
    def shown_status(self) -> str:
        """The status as shown to people: for an approved standing order, `in_force`."""
        if self.standing is not None and self.status == "verified":
            return "in_force"
        return self.status or "open"

    @property
    def choices(self) -> tuple[str, ...]:
        """The answers offered for the open question; empty without an open question."""
        waits = self.approval is not None and self.approval.state == "not_understood"
        return self.questions[-1].choices if waits and self.questions else ()

    @property
    def asked_choices(self) -> tuple[str, ...]:
        """The answers offered for the last question; empty if a later request has followed."""
        was_asked = self.approval_state == "not_understood" and self.questions
        return self.questions[-1].choices if was_asked else ()

    @property
    def still(self) -> ev.CameraStill | None:
        """The still shown with the plan that waits for approval; None without a plan or a still."""
        return self.stills.get(self.approval.attempt) if self.approval is not None else None

    @property
    def standings(self) -> dict[str, ev.WorkflowMoved]:
        """The last event of each track's workflow, by track."""
        return {move.track: move for move in self.workflow}

    @property
    def phase(self) -> str:
        """The phase of a workflow that the next plan is for; '' if no phase is left."""
        standings = self.standings.values()
        return next((m.phases[m.phase] for m in standings if 0 <= m.phase < len(m.phases)), "")

    @property
    def decision(self) -> Decision | None:
        """The last accepted decision."""
        return next((d.decision for d in reversed(self.decisions) if d.accepted), None)

    @property
    def verification(self) -> Verification | None:
        """The verification of the last executed plan by telemetry."""
        return self.verified[-1].verification if self.verified else None

    @property
    def outcome_verdict(self) -> Verdict | None:
        """The judge's verdict on the outcome of the last executed plan."""
        return self.verified[-1].verdict if self.verified else self.unasked_verdict


@dataclass
class Round:
    """One plan, from its first attempt to its verification or halt; `number` counts from 0."""

    number: int
    attempts: list[Attempt] = field(default_factory=list[Attempt])
    decisions: list[ev.DecisionMade] = field(default_factory=list[ev.DecisionMade])
    commands: list[CommandTrace] = field(default_factory=list[CommandTrace])
    halts: list[ev.PlanHalted] = field(default_factory=list[ev.PlanHalted])
    held: list[ev.StepsHeld] = field(default_factory=list[ev.StepsHeld])
    verified: list[VerifiedPlan] = field(default_factory=list[VerifiedPlan])
    voided: str = ""

    @property
    def name(self) -> str:
        """The phase of a workflow that the plan is for, or else the plan's number, in words."""
        phase = self.attempts[-1].phase if self.attempts else ""
        return f"Phase {phase}" if phase else f"Plan {self.number + 1}"

    @property
    def outcome(self) -> str:
        """The outcome of the plan: `halted`, the outcome of its verification, or `none`."""
        if self.halts:
            return "halted"
        return self.verified[-1].verification.outcome if self.verified else "none"


def rounds(trace: MissionTrace) -> list[Round]:
    """Return every round of the mission, oldest first; the last round may still be empty."""
    last = max([a.round for a in trace.attempts], default=0)
    result = [Round(number) for number in range(last + 1)]
    by_attempt = {attempt.number: attempt.round for attempt in trace.attempts}
    for attempt in trace.attempts:
        result[attempt.round].attempts.append(attempt)
    for made in trace.decisions:
        result[by_attempt.get(made.attempt, last)].decisions.append(made)
    for sent in trace.commands.values():
        result[min(sent.round, last)].commands.append(sent)
    for halt in trace.halts:
        result[by_attempt.get(halt.attempt, last)].halts.append(halt)
    for held in trace.held:
        result[by_attempt.get(held.attempt, last)].held.append(held)
    for item in trace.verified:
        result[min(item.round, last)].verified.append(item)
    result[-1].voided = trace.voided
    return result


def chosen_attempt(trace: MissionTrace, now: Round) -> Attempt | None:
    """Return the attempt in `now` that waits for approval or was decided on, else the latest."""
    if trace.approval is not None:
        number = trace.approval.attempt
    else:
        taken = (d.attempt for d in reversed(now.decisions) if d.accepted and d.decision.settles)
        number = next(taken, None)
    chosen = next((attempt for attempt in now.attempts if attempt.number == number), None)
    return chosen or (now.attempts[-1] if now.attempts else None)
