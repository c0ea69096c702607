"""The progress of a subject through an ordering of events or a workflow (WF-01).

An ordering's `event` and `other` (schema/rule.py Ordering) may use these variables:

it     with `each: track`, the track as a TrackMoment (schema/rehearsal.py); with `each: gate`,
       {covered, lost}: `covered` is true if the gate is known to be covered, `lost` if it was
       covered before and is not now.
id     the name of the track or gate.
now    the moment: {time_s, tracks, covered, up, orders}; `target` is '' for an order without one.
world  as for checks (policy/rule_variables.py).

A workflow's expressions may use `it`, the track, with its `id` and `now`, and also:

steady_s  seconds since the last change of the track's identity, intent, status, warning, defiance
          or suspected noncombatants.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Self

from pa_console.policy.expressions.expression import Expression, make_context
from pa_console.policy.expressions.fields import Fields, Shapes, flat, names_of
from pa_console.policy.rule_variables import WORLD_SHAPE, world_variables
from pa_console.policy.rulebook import CompiledWorkflow, Rulebook
from pa_console.schema.rehearsal import Moment, TrackMoment
from pa_console.schema.rule import Ordering, Phase, Workflow
from pa_console.schema.world import World

CLOCK_S = 1e-6
"""The difference below which two times count as equal, in seconds."""


class GateMoment(NamedTuple):
    """A gate at one moment; `lost` is true if it was covered before and is not covered now."""

    covered: bool
    lost: bool


Subject = TrackMoment | GateMoment | None
Subjects = Mapping[str, Subject]
WHOLE: Subjects = {"": None}
"""The only subject of an ordering without `each`: the moment as a whole."""


def subjects(order: Ordering, now: Moment, covered_before: Collection[str]) -> Subjects:
    """Return the subjects that `order` follows at this moment, by name."""
    if order.each == "track":
        return now.tracks
    if order.each == "gate":
        return {
            gate: GateMoment(covered, not covered and gate in covered_before)
            for gate, covered in now.covered.items()
        }
    return WHOLE


def moment_values(now: Moment) -> dict[str, Any]:
    """Return the moment as the plain values that CEL sees."""
    values = now.model_dump()
    for order in values["orders"]:
        order["target"] = order["target"] or ""
    return values


class Evaluator:
    """An evaluator of expressions about subjects in one world; it caches each distinct result."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._results: dict[tuple[Expression, str, tuple[Any, ...]], bool] = {}
        self._moment: Moment | None = None
        self._now: dict[str, Any] = {}

    def holds(self, expression: Expression, now: Moment, name: str, subject: Subject) -> bool:
        """Return whether `expression` holds for the subject; errors of the expression are raised.

        Raises TypeError if the result is neither true nor false.
        """
        reads = expression.reads(_SHAPES[type(subject)])
        values: dict[str, Any] = {}
        if "id" in reads:
            values["id"] = name
        if "it" in reads:
            values["it"] = _plain(subject, reads["it"])
        if "now" in reads:
            return self._evaluate(expression, reads, values | {"now": self._values(now)})
        key = (expression, values.get("id", ""), tuple(values.get("it", {}).values()))
        if key not in self._results:
            self._results[key] = self._evaluate(expression, reads, values)
        return self._results[key]

    def prepare(self, order: Ordering, *expressions: Expression) -> None:
        """Find the fields that the `expressions` of an ordering read, outside any deadline."""
        for expression in expressions:
            expression.reads(_SHAPES[_KINDS[order.each]])

    def copy(self) -> "Evaluator":
        """Return an evaluator that shares the cache; another thread may use it."""
        twin = object.__new__(Evaluator)
        twin._world, twin._results = self._world, self._results
        twin._moment, twin._now = self._moment, self._now
        return twin

    def number(self, expression: Expression) -> float:
        """Return the positive number that `expression` yields in this world; raises TypeError."""
        value: Any = expression.evaluate(
            make_context(self._worldly(expression.reads(_SHAPES[type(None)])))
        )
        if isinstance(value, bool) or not isinstance(value, (int, float)) or value <= 0:
            raise TypeError(f"it yields {value!r}, not a positive number")
        return float(value)

    def _evaluate(self, expression: Expression, reads: Fields, values: dict[str, Any]) -> bool:
        result: Any = expression.evaluate(make_context(values | self._worldly(reads)))
        if not isinstance(result, bool):
            raise TypeError(f"it yields {result!r}, not true or false")
        return result

    def _worldly(self, reads: Fields) -> dict[str, Any]:
        """Return the variable `world` with the fields that are read, or nothing if none are."""
        if "world" not in reads:
            return {}
        return {"world": world_variables(self._world, reads["world"])}

    def _values(self, now: Moment) -> dict[str, Any]:
        if self._moment is not now:
            self._moment, self._now = now, moment_values(now)
        return self._now


_NAMES: Mapping[type[Subject], Iterable[str]] = {
    TrackMoment: TrackMoment.model_fields,
    GateMoment: GateMoment._fields,
    type(None): (),
}
_SHAPES: Mapping[type[Subject], Shapes] = {
    kind: {"it": flat(names), "id": None, "now": None, "world": WORLD_SHAPE}
    for kind, names in _NAMES.items()
}
"""The structure of the variables for each kind of subject."""

_KINDS: Mapping[str | None, type[Subject]] = {
    "track": TrackMoment,
    "gate": GateMoment,
    None: type(None),
}


def _plain(subject: Subject, fields: Fields | None) -> dict[str, Any]:
    return {name: getattr(subject, name) for name in names_of(fields, _NAMES[type(subject)])}


Stage = Literal["idle", "open", "settled", "broken"]


class OrderingProgress(NamedTuple):
    """The state of a subject in an ordering.

    idle     nothing has happened yet
    open     something must still happen; for `within`, since `since_s` (simulated seconds)
    settled  the required event has happened, or is no longer required
    broken   the ordering is broken at present, and this has been reported
    """

    stage: Stage = "idle"
    since_s: float = 0.0

    def overdue(self, time_s: float, limit_s: float) -> bool:
        """Return whether a running time limit has passed at `time_s`."""
        return self.stage == "open" and time_s > self.since_s + limit_s + CLOCK_S


START = OrderingProgress()
_SETTLED, _BROKEN = OrderingProgress("settled"), OrderingProgress("broken")


def follow(
    order: Ordering,
    was: OrderingProgress,
    *,
    event: bool,
    other: bool,
    time_s: float,
    limit_s: float,
) -> tuple[OrderingProgress, bool]:
    """Return the subject's progress after this moment, and whether it broke the ordering now.

    The values of the previous moment are assumed to have held until this one. `limit_s` is the
    limit of `within`.
    """
    match order.kind:
        case "before":
            if was.stage == "settled" or other:
                return _SETTLED, False
            return (_SETTLED, True) if event else (START, False)
        case "after":
            if was.stage == "settled" or not (other or was.stage == "open"):
                return was, False
            began = was if was.stage == "open" else OrderingProgress("open", time_s)
            return (_SETTLED if event else began), False
        case "never_while":
            return _wrong_while(event and other, was)
        case "until":
            if was.stage == "settled" or other:
                return _SETTLED, False
            return _wrong_while(not event, was)
        case "within":
            return _in_time(was, event, other, time_s, limit_s)


def leave(
    order: Ordering, was: OrderingProgress, time_s: float, limit_s: float
) -> tuple[OrderingProgress, bool]:
    """Return the same as `follow` for a subject that has disappeared, whose states have ended."""
    if order.kind in ("never_while", "within"):
        return follow(order, was, event=False, other=False, time_s=time_s, limit_s=limit_s)
    return was, False


def _wrong_while(wrong: bool, was: OrderingProgress) -> tuple[OrderingProgress, bool]:
    """Report a violation once; report it again only if it was resolved in between."""
    return (_BROKEN, was.stage != "broken") if wrong else (START, False)


def _in_time(
    was: OrderingProgress, event: bool, other: bool, time_s: float, limit_s: float
) -> tuple[OrderingProgress, bool]:
    """Follow one obligation from the beginning of `other` until it is met or `other` ends."""
    late = was.overdue(time_s, limit_s)
    if not other:
        return START, late
    if event or was.stage == "settled":
        return _SETTLED, late
    if late or was.stage == "broken":
        return _BROKEN, late
    return (was if was.stage == "open" else OrderingProgress("open", time_s)), late


StageFacts = tuple[str, str, str, bool, bool, bool]


class WorkflowMove(NamedTuple):
    """One step of a workflow: a phase done or skipped, or the end with its outcome in words."""

    what: Literal["done", "skipped", "ended"]
    phase: str = ""
    outcome: str = ""


@dataclass
class WorkflowRun:
    """The progress of one track through one workflow; `position` counts phases from 0.

    An expression that cannot be evaluated counts as false. The workflow then stays in its phase,
    and the operator is shown the expression.
    """

    compiled: CompiledWorkflow
    track: str
    gate: str
    position: int = 0
    skipped: tuple[str, ...] = ()
    outcome: str = ""
    ended: bool = False
    _facts: StageFacts | None = field(default=None, repr=False)
    _since_s: float = field(default=0.0, repr=False)

    @classmethod
    def start(cls, rulebook: Rulebook, now: Moment, track: str) -> Self | None:
        """Enter the first workflow that starts for `track` at this moment; None if none starts."""
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
        """The workflow as written in the rule file."""
        return self.compiled.workflow

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Every phase, in order."""
        return self.workflow.phases

    @property
    def current(self) -> Phase | None:
        """The phase to carry out; None if the workflow is over."""
        return self.phases[self.position] if self.position < len(self.phases) else None

    @property
    def over(self) -> bool:
        """True if no phase is left."""
        return self.position >= len(self.phases)

    def command(self) -> str:
        """Return the current phase's mission with its names filled in; '' after the last phase."""
        phase = self.current
        return "" if phase is None else phase.mission(self.track, self.gate)

    def advance(self, now: Moment) -> list[WorkflowMove]:
        """Update from the next moment: pass phases that are done or do not apply, then check ends.

        The ends are checked after the phases so that the trace shows which phases were skipped. If
        no end holds yet, the ends are checked again at later moments.
        """
        if self.ended:
            return []
        if self.track not in now.tracks:
            return [self._end(self.workflow.gone)]
        self._look(now)
        moves: list[WorkflowMove] = []
        while (phase := self.current) is not None:
            expressions = self.compiled.phases[self.position]
            if self._holds(expressions.done, now):
                moves.append(WorkflowMove("done", phase.name))
            elif self._holds(expressions.when, now):
                break
            else:
                moves.append(WorkflowMove("skipped", phase.name))
                self.skipped = (*self.skipped, phase.name)
            self.position += 1
        for outcome, expression in self.compiled.ends:
            if self._holds(expression, now):
                return [*moves, self._end(outcome)]
        return [*moves, self._end("")] if self.over and not self.compiled.ends else moves

    def _end(self, outcome: str) -> WorkflowMove:
        self.position, self.outcome, self.ended = len(self.phases), outcome, True
        return WorkflowMove("ended", outcome=outcome)

    def _look(self, now: Moment) -> None:
        """Update the track's gate and the time since which its facts have been the same."""
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
        except Exception:  # whatever CEL raises: the expression does not hold
            return False


def _facts(track: TrackMoment) -> StageFacts:
    return (
        track.identity,
        track.intent,
        track.status,
        track.warned,
        track.defiant,
        track.noncombatants,
    )
