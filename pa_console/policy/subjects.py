"""What an ordering is about at one moment, and whether its expressions hold for each of them.

An ordering's `event` and `other` may use these variables:

it     with `each: track`, the track as schema/moment.py TrackMoment; with `each: gate`,
       {covered, lost}: whether it is known to be covered, and whether it is not but has been.
id     the name of the track or gate.
now    the moment: {time_s, tracks, covered, up, orders}; an order's `target` is '' for none.
world  as for checks (policy/context.py).
"""

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from pa_console.policy.context import world_variables
from pa_console.policy.expression import Expression, make_context
from pa_console.schema.moment import Moment, TrackMoment
from pa_console.schema.rule import Ordering
from pa_console.schema.world import World


class GateMoment(NamedTuple):
    """A gate at one moment; `lost` is one that was covered before and is not now."""

    covered: bool
    lost: bool


Subject = TrackMoment | GateMoment | None
Subjects = Mapping[str, Subject]
WHOLE: Subjects = {"": None}
"""The one subject of an ordering that is about the moment as a whole."""


def subjects(order: Ordering, now: Moment, covered_before: Collection[str]) -> Subjects:
    """Return what `order` follows at this moment, by name."""
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
    """Evaluates expressions for subjects in one world, each distinct question only once."""

    def __init__(self, world: World) -> None:
        self._world = world_variables(world)
        self._known: dict[tuple[Expression, str, Subject], bool] = {}
        self._moment: Moment | None = None
        self._now: dict[str, Any] = {}

    def holds(self, expression: Expression, now: Moment, name: str, subject: Subject) -> bool:
        """Return whether `expression` holds for the subject; raises what it runs into.

        Raises TypeError when it yields anything but true or false.
        """
        if "now" in expression.variables:
            return self._evaluate(expression, now, name, subject)
        key = (expression, name if "id" in expression.variables else "", subject)
        if key not in self._known:
            self._known[key] = self._evaluate(expression, now, name, subject)
        return self._known[key]

    def copy(self) -> "Evaluator":
        """Return one that knows as much and may be used by another thread."""
        twin = object.__new__(Evaluator)
        twin._world, twin._known = self._world, self._known
        twin._moment, twin._now = self._moment, self._now
        return twin

    def number(self, expression: Expression) -> float:
        """Return the positive number that the world gives `expression`, else TypeError."""
        value: Any = expression.evaluate(make_context({"world": self._world}))
        if isinstance(value, bool) or not isinstance(value, (int, float)) or value <= 0:
            raise TypeError(f"it yields {value!r}, not a positive number")
        return float(value)

    def _evaluate(self, expression: Expression, now: Moment, name: str, subject: Subject) -> bool:
        values: dict[str, Any] = {"id": name, "world": self._world}
        if "it" in expression.variables:
            values["it"] = _plain(subject)
        if "now" in expression.variables:
            if self._moment is not now:
                self._moment, self._now = now, moment_values(now)
            values["now"] = self._now
        asked = {key: values[key] for key in expression.variables}
        result: Any = expression.evaluate(make_context(asked))
        if not isinstance(result, bool):
            raise TypeError(f"it yields {result!r}, not true or false")
        return result


def _plain(subject: Subject) -> dict[str, Any]:
    if isinstance(subject, TrackMoment):
        return subject.model_dump()
    return subject._asdict() if subject is not None else {}
