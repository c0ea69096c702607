"""Where one track stands in a workflow that a rule prescribes (WF-01): a pure state machine.

A workflow's expressions may use these variables:

it        the track as schema/rehearsal.py TrackMoment.
id        its id.
now       the moment: {time_s, tracks, covered, up, orders}; an order's `target` is '' for none.
steady_s  seconds since what the track is, or has done, last changed: identity, intent, status,
          warning, defiance, suspected noncombatants.
"""

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Self

from pa_console.policy.expressions.expression import Expression, make_context
from pa_console.policy.ordering.ordering import moment_values
from pa_console.policy.rulebook import CompiledWorkflow, Rulebook
from pa_console.schema.rehearsal import Moment, TrackMoment
from pa_console.schema.rule import Phase, Workflow

Facts = tuple[str, str, str, bool, bool, bool]


class Move(NamedTuple):
    """One step of a workflow: a phase done or skipped, or the end with its outcome in words."""

    what: Literal["done", "skipped", "ended"]
    phase: str = ""
    outcome: str = ""


@dataclass
class WorkflowRun:
    """One track's way through one workflow; `position` counts phases from 0.

    An expression that cannot be evaluated holds for nothing: the workflow stays where it is, and
    the operator sees where.
    """

    compiled: CompiledWorkflow
    track: str
    gate: str
    position: int = 0
    skipped: tuple[str, ...] = ()
    outcome: str = ""
    ended: bool = False
    _facts: Facts | None = field(default=None, repr=False)
    _since_s: float = field(default=0.0, repr=False)

    @classmethod
    def start(cls, rulebook: Rulebook, now: Moment, track: str) -> Self | None:
        """Enter the first workflow that starts for `track` at this moment, None if none does."""
        if track not in now.tracks:
            return None
        for compiled in rulebook.workflows:
            run = cls(compiled, track, now.tracks[track].gate)
            run._look(now)
            if run._holds(compiled.starts, now):
                return run
        return None

    @property
    def workflow(self) -> Workflow:
        """The workflow as the rule file has it."""
        return self.compiled.workflow

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Every phase, in order."""
        return self.workflow.phases

    @property
    def current(self) -> Phase | None:
        """The phase to carry out, None when the workflow is over."""
        return self.phases[self.position] if self.position < len(self.phases) else None

    @property
    def over(self) -> bool:
        """True if no phase is left."""
        return self.position >= len(self.phases)

    def command(self) -> str:
        """Return the current phase's mission with the names put in, empty when it is over."""
        phase = self.current
        return "" if phase is None else phase.mission(self.track, self.gate)

    def advance(self, now: Moment) -> list[Move]:
        """Take in the next moment: go past every phase that is done or does not apply, then end.

        The end is looked for after the phases, so that the trace says which were skipped; when
        none of them holds yet, it is looked for at later moments too.
        """
        if self.ended:
            return []
        if self.track not in now.tracks:
            return [self._end(self.workflow.gone)]
        self._look(now)
        moves: list[Move] = []
        while (phase := self.current) is not None:
            expressions = self.compiled.phases[self.position]
            if self._holds(expressions.done, now):
                moves.append(Move("done", phase.name))
            elif self._holds(expressions.when, now):
                break
            else:
                moves.append(Move("skipped", phase.name))
                self.skipped = (*self.skipped, phase.name)
            self.position += 1
        for outcome, expression in self.compiled.ends:
            if self._holds(expression, now):
                return [*moves, self._end(outcome)]
        return [*moves, self._end("")] if self.over and not self.compiled.ends else moves

    def _end(self, outcome: str) -> Move:
        self.position, self.outcome, self.ended = len(self.phases), outcome, True
        return Move("ended", outcome=outcome)

    def _look(self, now: Moment) -> None:
        """Note the track's gate, and since when it has been as it is."""
        track = now.tracks[self.track]
        facts = _facts(track)
        if facts != self._facts:
            self._facts, self._since_s = facts, now.time_s
        self.gate = track.gate

    def _holds(self, expression: Expression, now: Moment) -> bool:
        values: dict[str, Any] = {"id": self.track, "steady_s": now.time_s - self._since_s}
        if "it" in expression.variables:
            values["it"] = now.tracks[self.track].model_dump()
        if "now" in expression.variables:
            values["now"] = moment_values(now)
        try:
            return expression.evaluate(make_context(values)) is True
        except Exception:  # whatever CEL runs into: it holds for nothing
            return False


def _facts(track: TrackMoment) -> Facts:
    return (
        track.identity,
        track.intent,
        track.status,
        track.warned,
        track.defiant,
        track.noncombatants,
    )
