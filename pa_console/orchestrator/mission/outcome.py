"""The result of a mission's executed plans: its status, and its open points (Step 7)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pa_console.language.reading import read_reason
from pa_console.orchestrator.mission.workflow_progress import WorkflowProgress
from pa_console.orchestrator.tasking.fulfilment import is_to_be_warned
from pa_console.policy.ordering.monitor import Monitor
from pa_console.schema.alarm import Alarm
from pa_console.schema.mission import Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture


@dataclass(frozen=True)
class Outcome:
    """The result of a mission, and its reason."""

    status: MissionStatus
    reason: str


@dataclass
class Results:
    """The verification of every plan, beside the mission's workflows, orderings and alarm."""

    mission: Mission
    progress: WorkflowProgress
    monitor: Monitor
    open_alarms: Callable[[], Sequence[Alarm]]
    verifications: list[Verification] = field(default_factory=list[Verification])

    @property
    def unanswered(self) -> tuple[str, ...]:
        """The alarm that the mission answers while it is open still; a workflow is the answer."""
        alarm = self._alarm
        return (f"alarm {alarm.id} is still open: {alarm.text}",) if alarm is not None else ()

    @property
    def follow_up(self) -> Mission | None:
        """Return the mission's alarm in its present words; None when it is answered.

        An alarm asks for one thing after the other: first a relief, then the way home (CAP-04).
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
        """Return what the plan for `following` has to make good of the one for `last`."""
        verification = self.verifications[-1]
        failed = (verification.reason,) if verification.outcome == "fail" else ()
        return (*failed, *(self.unanswered if following.text == last.text else ()))

    @property
    def _alarm(self) -> Alarm | None:
        """The mission's alarm while it is open and no workflow answers it."""
        if self.progress.entered:
            return None
        return next((a for a in self.open_alarms() if a.id == self.mission.alarm), None)

    def conclude(self) -> Outcome:
        """Return what the plans, the workflow, the orderings and the alarm come to.

        Verified takes all of them; what telemetry could not tell is not verified.
        """
        reasons = [verification.reason for verification in self.verifications]
        if self.progress.entered:
            reasons = [self.progress.summary, *reasons[-1:]]
        open_rules = [f"{f.rule_id}: {f.message}" for f in self.monitor.finish() if f.blocking]
        reasons += [*open_rules, *self.unanswered]
        passed = all(verification.outcome == "pass" for verification in self.verifications)
        passed = passed and self.progress.over and self.progress.settled
        passed = passed and not open_rules and not self.unanswered
        status: MissionStatus = "verified" if passed else "unverified"
        return Outcome(status, "; ".join(dict.fromkeys(reasons)))


def begun(plan: Plan, task: Mission, picture: Picture) -> Mission | None:
    """Return `task` if its executed `plan` could only begin it (WF-01).

    A contact that is to be warned is identified first. If it turns out to be no threat, the
    workflow does not go on, although the warning was asked for.
    """
    reading = read_reason(plan.reason)
    asks = reading.asks if reading is not None else ()
    gates = {ask.place for ask in asks if ask.task == "warn"}
    due = (track for track in picture.tracks.values() if track.gate in gates)
    return task if any(is_to_be_warned(t) and t.status != "leaving" for t in due) else None
