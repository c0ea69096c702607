"""The position of a mission in the workflows that rules prescribe (WF-01): phase after phase."""

from collections.abc import Iterator

from pa_console.policy.expressions.deadlines import shared_deadline
from pa_console.policy.ordering.workflow import WorkflowRun
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import ENCOUNTERS, Verb
from pa_console.schema.events.event import WorkflowMoved
from pa_console.schema.mission import Mission
from pa_console.schema.moment import Moment
from pa_console.schema.plan import Plan

MOMENT_S = 0.02
TRACK_S = 0.002
"""Seconds of processor time that all workflows may take at one moment, and for each track."""


class WorkflowProgress:
    """The workflows of one mission, one a track; the first that is not over sets the task."""

    def __init__(self, rulebook: Rulebook, mission: Mission) -> None:
        self._rulebook, self._mission = rulebook, mission
        self._runs: dict[str, WorkflowRun] = {}

    @property
    def entered(self) -> bool:
        """True if the mission is in a workflow, or went through one."""
        return bool(self._runs)

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks whose workflow the mission is in."""
        return tuple(self._runs)

    @property
    def over(self) -> bool:
        """True if no workflow has a phase left."""
        return all(run.current is None for run in self._runs.values())

    @property
    def settled(self) -> bool:
        """True if every workflow without a phase left has come to its end."""
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
        """Track and name of the phase to plan next, empty when there is none."""
        for track, run in self._runs.items():
            if run.current is not None:
                return f"{track} {run.current.name}"
        return ""

    @property
    def task(self) -> Mission | None:
        """The phase to be planned next, as a mission of its own words."""
        for track, run in self._runs.items():
            if run.current is not None:
                words = {"text": run.command(), "subject": track, "gate": run.gate}
                return self._mission.model_copy(update=words)
        return None

    @property
    def verbs(self) -> tuple[Verb, ...]:
        """The commands that the next phase is made of; none means that it does not say."""
        phases = [run.current for run in self._runs.values() if run.current is not None]
        return phases[0].verbs if phases else ()

    def begin(self, now: Moment) -> Iterator[WorkflowMoved]:
        """Enter the workflow of the track that an alarm's mission is about."""
        if self._mission.subject in now.tracks and self._mission.subject not in self._runs:
            yield from self._enter(self._mission.subject, now)

    def join(self, plan: Plan, now: Moment) -> Iterator[WorkflowMoved]:
        """Enter the workflow of every track that an executed plan has dealt with."""
        gates = {action.target for action in plan.actions if action.verb in ENCOUNTERS}
        for name, track in now.tracks.items():
            if track.gate in gates and name not in self._runs:
                yield from self._enter(name, now)

    def observe(self, now: Moment) -> Iterator[WorkflowMoved]:
        """Move on every workflow whose phase, or which itself, is over at `now`."""
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
