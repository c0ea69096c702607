"""The conditions of standing orders: CEL over one asset, track or gate of the picture.

An expression may use these variables:

it      the asset, track or gate in question. An asset is {id, kind, at, post, position, speed_mps,
        status, task, battery_pct, low_battery, comms, available, stale, integrity, stamp_s}, a gate
        {name, covered, by, uncovered_s, unsure}; a track has every field of `Track`. An unknown
        value is ''.
id      the name of `it`.
now     {time_s, weather}.
world   as in a rule's check.

A condition on a stale asset or track, or on an asset that is suspect or has lost its link, is
unknown, unless the expression itself reads one of the fields that show this.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pa_console.policy.expressions.deadlines import DEADLINE_S, shared_deadline
from pa_console.policy.expressions.expression import SUBJECT_VARIABLES, Expression, make_context
from pa_console.policy.expressions.fields import Record, Shapes, flat, names_of
from pa_console.policy.rule_variables import WORLD_SHAPE, world_variables
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import StandingOrder, SubjectKind
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import World

MOST_SIZE = 200
"""The largest number of tokens in one condition."""
LOOK_S = 0.05
"""Seconds of processor time for one condition over all subjects of a picture."""

_HIDDEN = frozenset(("heading_deg", "route", "command_id"))
_FIELDS: Mapping[SubjectKind, Record] = {
    "asset": flat(AssetTelemetry.model_fields.keys() - _HIDDEN),
    "track": flat(Track.model_fields.keys() - _HIDDEN),
    "gate": flat(("name", *GateCover.model_fields)),
}
_NOW = flat(("time_s", "weather"))
_OF_SILENCE = frozenset(("stale", "comms", "available", "integrity", "status"))
"""The fields that show whether telemetry is missing or unreliable."""


@dataclass
class StandingCondition:
    """The condition of one standing order, compiled for pictures of `world`.

    Raises ValueError for CEL that does not compile, is too large or uses unknown names.
    """

    order: StandingOrder
    world: World
    _seen: dict[str, tuple[object, bool]] = field(
        default_factory=dict[str, tuple[object, bool]], repr=False
    )
    """The latest facts and the result for each subject."""

    def __post_init__(self) -> None:
        if self.order.each is None:
            raise ValueError("an order with a time has no condition")
        fields = _FIELDS[self.order.each]
        self._expression = Expression(self.order.condition, SUBJECT_VARIABLES, DEADLINE_S)
        if self._expression.size > MOST_SIZE:
            raise ValueError(f"the condition is too large: at most {MOST_SIZE} words and signs")
        shapes: Shapes = {
            "it": fields, "id": None, "now": _NOW, "world": WORLD_SHAPE,
        }  # fmt: skip
        self._reads = self._expression.reads(shapes)
        read = self._reads.get("it", {})
        self._fields = tuple(sorted(names_of(read, fields.fields)))
        self._of_silence = bool(_OF_SILENCE & set(self._fields))

    @cached_property
    def _world(self) -> dict[str, Any]:
        return world_variables(self.world) if "world" in self._expression.variables else {}

    def holding(self, picture: Picture) -> Mapping[str, bool | None]:
        """Return, for every subject, whether the condition holds; None if that is unknown.

        Raises the errors of the expression, and DeadlineError if it takes too long.
        """
        states: dict[str, bool | None] = {}
        now = {"time_s": picture.time_s, "weather": picture.weather}
        timed = "now" in self._expression.variables
        with shared_deadline(LOOK_S, len(picture.assets)):
            for name, subject in self._subjects(picture):
                if not self._of_silence and _unknown(subject):
                    states[name] = None
                    continue
                values = {field: _value(subject, field, name) for field in self._fields}
                key = (values, now if timed else None)
                previous = self._seen.get(name)
                if previous is None or previous[0] != key:
                    previous = key, self._decide(name, values, now)
                    self._seen[name] = previous
                states[name] = previous[1]
        for gone in self._seen.keys() - states.keys():
            del self._seen[gone]
        return states

    def _subjects(
        self, picture: Picture
    ) -> Iterator[tuple[str, AssetTelemetry | Track | GateCover]]:
        match self.order.each:
            case "asset":
                yield from picture.assets.items()
            case "track":
                yield from picture.tracks.items()
            case "gate":
                yield from picture.gates.items()
            case None:
                pass

    def _decide(self, name: str, values: dict[str, Any], now: dict[str, Any]) -> bool:
        given = {"it": values, "id": name, "now": now, "world": self._world}
        read = {field: given[field] for field in self._expression.variables}
        result: Any = self._expression.evaluate(make_context(read))
        if not isinstance(result, bool):
            raise ValueError(f"it yields {result!r}, not true or false")
        return result


def _unknown(subject: StrictModel) -> bool:
    """Return whether all facts of a subject are uncertain."""
    if isinstance(subject, AssetTelemetry):
        return subject.stale or subject.integrity == "suspect" or subject.comms == "lost"
    return isinstance(subject, Track) and subject.stale


def _value(subject: StrictModel, field_name: str, name: str) -> Any:
    value = name if field_name == "name" else getattr(subject, field_name)
    return "" if value is None else value
