"""Step 9: the progress of a mission in its workflows (WF-01), and the mission's result."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from pa_console.language.canonical.reading import read_reason
from pa_console.mission.context import MissionResult
from pa_console.mission.planning.fulfilment import is_to_be_warned
from pa_console.policy.expressions.deadlines import shared_deadline
from pa_console.policy.monitor import Monitor
from pa_console.policy.orderings import WorkflowRun
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import ENCOUNTERS, Verb
from pa_console.schema.events.event import WorkflowMoved
from pa_console.schema.mission import Alarm, Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Moment
from pa_console.schema.telemetry import Picture

MOMENT_S = 0.02
TRACK_S = 0.002
"""The processor time in seconds by which each workflow extends the limit for one moment."""


class WorkflowProgress:
    """The workflows of one mission, one per track; the first unfinished one gives the next task."""

    def __init__(self, rulebook: Rulebook, mission: Mission) -> None:
        self._rulebook, self._mission = rulebook, mission
        self._runs: dict[str, WorkflowRun] = {}

    @property
    def entered(self) -> bool:
        """True if the mission is in a workflow or has been in one."""
        return bool(self._runs)

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks of the mission's workflows."""
        return tuple(self._runs)

    @property
    def over(self) -> bool:
        """True if no workflow has a phase left."""
        return all(run.current is None for run in self._runs.values())

    @property
    def settled(self) -> bool:
        """True if every workflow that has no further phase has also ended."""
        return all(run.current is not None or run.ended for run in self._runs.values())

    @property
    def summary(self) -> str:
        """The outcome of every workflow in words."""
        return "; ".join(
            f"{track}: stopped at {run.current.name}"
            if run.current is not None
            else f"{track}: {run.outcome or ('every phase done' if run.ended else 'no outcome')}"
            for track, run in self._runs.items()
        )

    @property
    def phase(self) -> str:
        """The next phase to plan, as its track and its name; '' if no phase is left."""
        for track, run in self._runs.items():
            if run.current is not None:
                return f"{track} {run.current.name}"
        return ""

    @property
    def task(self) -> Mission | None:
        """The next phase to plan, as a mission with a text of its own; None if no phase is left."""
        for track, run in self._runs.items():
            if run.current is not None:
                words = {"text": run.command(), "subject": track, "gate": run.gate}
                return self._mission.model_copy(update=words)
        return None

    @property
    def verbs(self) -> tuple[Verb, ...]:
        """The commands that the next phase allows; empty if it does not limit them."""
        phases = [run.current for run in self._runs.values() if run.current is not None]
        return phases[0].verbs if phases else ()

    def begin(self, now: Moment) -> Iterator[WorkflowMoved]:
        """Enter the workflow for the track that is the subject of the mission, if there is one."""
        if self._mission.subject in now.tracks and self._mission.subject not in self._runs:
            yield from self._enter(self._mission.subject, now)

    def join(self, plan: Plan, now: Moment) -> Iterator[WorkflowMoved]:
        """Enter the workflow for every track that an executed plan has dealt with."""
        gates = {action.target for action in plan.actions if action.verb in ENCOUNTERS}
        for name, track in now.tracks.items():
            if track.gate in gates and name not in self._runs:
                yield from self._enter(name, now)

    def observe(self, now: Moment) -> Iterator[WorkflowMoved]:
        """Advance every workflow that has ended, or whose phase has ended, at `now`."""
        with shared_deadline(MOMENT_S + TRACK_S * len(self._runs)):
            moved = [run for run in self._runs.values() if run.advance(now)]
        yield from map(_moved, moved)

    def _enter(self, track: str, now: Moment) -> Iterator[WorkflowMoved]:
        with shared_deadline(MOMENT_S):
            run = WorkflowRun.start(self._rulebook, now, track)
            if run is not None:
                run.advance(now)
        if run is not None:
            self._runs[track] = run
            yield _moved(run)


def _moved(run: WorkflowRun) -> WorkflowMoved:
    return WorkflowMoved(
        workflow=run.workflow.id,
        rule_id=run.workflow.rule,
        track=run.track,
        phases=tuple(phase.name for phase in run.workflow.phases),
        phase=run.position,
        skipped=run.skipped,
        command=run.command() if run.current is not None else "",
        outcome=run.outcome,
    )


@dataclass
class Results:
    """The results of one mission: its plans' verifications, workflows, orderings and alarm."""

    mission: Mission
    progress: WorkflowProgress
    monitor: Monitor
    open_alarms: Callable[[], Sequence[Alarm]]
    verifications: list[Verification] = field(default_factory=list[Verification])
    idle: list[str] = field(default_factory=list[str])
    """One text per executed plan: the parts of the order left out by a plan that only held, or
    ''."""

    @property
    def unanswered(self) -> tuple[str, ...]:
        """The mission's alarm in words, if it is still open and no workflow deals with it."""
        alarm = self._alarm
        return (f"alarm {alarm.id} is still open: {alarm.text}",) if alarm is not None else ()

    @property
    def follow_up(self) -> Mission | None:
        """The mission with the present command of its alarm; None if no command is left.

        An alarm may require several commands in turn: first a relief, then the return to base
        (CAP-04).
        """
        alarm = self._alarm
        if alarm is None or not alarm.command:
            return None
        return self.mission.model_copy(update={"text": alarm.command})

    def awaits(self, phase: str, task: Mission) -> bool:
        """Return whether `phase` or `task` may still end without another plan."""
        if (phase and self.progress.phase == phase) or not self.progress.settled:
            return True
        following = self.follow_up
        return following is not None and following.text == task.text

    def lacking(self, following: Mission, last: Mission) -> tuple[str, ...]:
        """Return the faults of the plan for `last` that the plan for `following` has to correct."""
        verification = self.verifications[-1]
        failed = (verification.reason,) if verification.outcome == "fail" else ()
        return (*failed, *(self.unanswered if following.text == last.text else ()))

    @property
    def _alarm(self) -> Alarm | None:
        """The mission's alarm while it is open and no workflow deals with it; otherwise None."""
        if self.progress.entered:
            return None
        return next((a for a in self.open_alarms() if a.id == self.mission.alarm), None)

    def conclude(self) -> MissionResult:
        """Return the mission's result from its plans, workflows, orderings and alarm.

        The mission is verified only if every plan passed, every workflow is over, no ordering is
        open and the alarm is answered. If every plan only held although more was ordered, the
        mission is held.
        """
        if self.idle and all(self.idle):
            return MissionResult("held", f"nothing was done: {'; '.join(dict.fromkeys(self.idle))}")
        reasons = [verification.reason for verification in self.verifications]
        if self.progress.entered:
            reasons = [self.progress.summary, *reasons[-1:]]
        open_rules = [f"{f.rule_id}: {f.message}" for f in self.monitor.finish() if f.blocking]
        reasons += [*open_rules, *self.unanswered]
        passed = all(verification.outcome == "pass" for verification in self.verifications)
        passed = passed and self.progress.over and self.progress.settled
        passed = passed and not open_rules and not self.unanswered
        status: MissionStatus = "verified" if passed else "unverified"
        return MissionResult(status, "; ".join(dict.fromkeys(reasons)))


def begun(plan: Plan, task: Mission, picture: Picture) -> Mission | None:
    """Return `task` if the executed `plan` was only its first part (WF-01); None otherwise.

    A contact must be identified before it is warned. If it turns out to be no threat, the workflow
    does not continue, although a warning was ordered.
    """
    reading = read_reason(plan.reason)
    asks = reading.asks if reading is not None else ()
    gates = {ask.place for ask in asks if ask.task == "warn"}
    due = (track for track in picture.tracks.values() if track.gate in gates)
    return task if any(is_to_be_warned(t) and t.status != "leaving" for t in due) else None
