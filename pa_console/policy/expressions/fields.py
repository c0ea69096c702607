"""Which fields of the values that it is given an expression reads: nothing else is converted.

Converting a value for CEL takes longer than deciding most rules, and a loop copies each element
with everything in it. So a record is given without the fields that no expression can notice. An
expression notices a field when it names it, and all of a record when it does with it anything but
taking a field, going through it as an element, or comparing it with null: compares it with another,
counts or looks up its keys, takes one by a name that it works out, or yields it. Where nothing is
known for certain everything counts as read.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from pa_console.policy.expressions.syntax import (
    LOOPS,
    Call,
    Constant,
    Index,
    Listing,
    Operation,
    Select,
    SyntaxNode,
    Variable,
)

Fields = Mapping[str, "Fields | None"]
"""Fields by name, each with those read of it; None stands for all. A list or map has those of its
elements."""


@dataclass(frozen=True)
class Record:
    """A value with fixed fields."""

    fields: "Mapping[str, Shape]"


@dataclass(frozen=True)
class Many:
    """A list of records, or a map of them by name."""

    of: Record
    keyed: bool = False


Shape = Record | Many | None
"""The structure of a value; None for one without records, which is always given whole."""

Shapes = Mapping[str, Shape]


def flat(names: Iterable[str]) -> Record:
    """Return a record of fields that have no records in them."""
    return Record(dict.fromkeys(names))


def everything(names: Iterable[str]) -> Fields:
    """Return the variables `names` with all their fields."""
    return dict.fromkeys(names)


def united(parts: Iterable[Fields]) -> Fields:
    """Return what at least one of `parts` reads."""
    found: dict[str, Fields | None] = {}
    for part in parts:
        for name, inner in part.items():
            known = found.get(name, {})
            found[name] = None if known is None or inner is None else united((known, inner))
    return found


def within(fields: Fields | None, name: str) -> Fields | None:
    """Return the read part of the field `name`, which is one of `fields`."""
    return None if fields is None else fields[name]


def names_of(fields: Fields | None, every: Iterable[str]) -> Iterable[str]:
    """Return the names of the `fields`, `every` one where all are read."""
    return every if fields is None else fields


def fields_read(tree: SyntaxNode, shapes: Shapes) -> Fields:
    """Return what the expression `tree` reads of the variables that `shapes` describes."""
    roots = {name: _ReadValue(shape) for name, shape in shapes.items()}
    reader = _FieldReader(roots)
    _whole(reader.read(tree, {}))
    return {name: roots[name].fields() for name in reader.named}


@dataclass
class _ReadValue:
    """A value that an expression is given, and what has been read of it."""

    shape: Shape
    whole: bool = False
    parts: "dict[str, _ReadValue]" = field(default_factory=dict)  # pyright: ignore[reportUnknownVariableType] - its own type
    element: "_ReadValue | None" = None

    def __post_init__(self) -> None:
        if isinstance(self.shape, Many):
            self.element = _ReadValue(self.shape.of)

    def fields(self) -> Fields | None:
        if self.element is not None:
            return self.element.fields()
        if self.whole or self.shape is None:
            return None
        return {name: part.fields() for name, part in self.parts.items()}

    def part(self, name: str) -> "_ReadValue | None":
        """Return the field `name`, None when there is none or it is a plain value."""
        if not isinstance(self.shape, Record) or name not in self.shape.fields:
            return None
        return self.parts.setdefault(name, _ReadValue(self.shape.fields[name]))


_Value = _ReadValue | None
"""The record behind a value; None for a plain value, or for one that is read as a whole."""


def _whole(value: _Value) -> None:
    """Note that everything in `value` is read."""
    if value is not None:
        value.whole = True
        _whole(value.element)


class _FieldReader:
    """Follows the values through an expression; `named` are the variables that it speaks of."""

    def __init__(self, roots: Mapping[str, _ReadValue]) -> None:
        self._roots = roots
        self.named: set[str] = set()

    def read(self, node: SyntaxNode, bound: Mapping[str, _Value]) -> _Value:
        """Return the value of `node`; `bound` is what the loops around it go through."""
        match node:
            case Constant():
                return None
            case Variable(name):
                return self._variable(name, bound)
            case Select(of, name):
                return self._select(self.read(of, bound), name)
            case Index(of, at):
                return self._index(self.read(of, bound), at, bound)
            case Call():
                return self._call(node, bound)
            case Operation(sign, operands):
                return self._operation(sign, operands, bound)
            case Listing(_, items):
                self._read_whole(items, bound)
                return None

    def _variable(self, name: str, bound: Mapping[str, _Value]) -> _Value:
        if name in bound:
            return bound[name]
        if name not in self._roots:
            return None
        self.named.add(name)
        return self._roots[name]

    def _select(self, value: _Value, name: str) -> _Value:
        if value is None:
            return None
        if isinstance(value.shape, Many):
            return value.element
        return value.part(name)

    def _index(self, value: _Value, at: SyntaxNode, bound: Mapping[str, _Value]) -> _Value:
        self._read_whole((at,), bound)
        if value is None or value.element is not None:
            return None if value is None else value.element
        _whole(value)
        return None

    def _call(self, call: Call, bound: Mapping[str, _Value]) -> _Value:
        if call.target is None:
            if call.name == "size" and len(call.arguments) == 1:
                self._count(self.read(call.arguments[0], bound))
            elif call.name == "has" and len(call.arguments) == 1:
                self.read(call.arguments[0], bound)
            else:
                self._read_whole(call.arguments, bound)
            return None
        target = self.read(call.target, bound)
        if call.name == "size" and not call.arguments:
            self._count(target)
            return None
        parts = (2, 3) if call.name == "map" else (2,)
        if call.name in LOOPS and len(call.arguments) in parts:
            variable, *bodies = call.arguments
            if isinstance(variable, Variable):
                return self._loop(call.name, target, variable.name, bodies, bound)
        _whole(target)
        self._read_whole(call.arguments, bound)
        return None

    def _loop(
        self,
        name: str,
        target: _Value,
        variable: str,
        bodies: Sequence[SyntaxNode],
        bound: Mapping[str, _Value],
    ) -> _Value:
        """Return what a loop over `target` yields; over a map, it goes through the keys."""
        self._count(target)
        listed = target is not None and isinstance(target.shape, Many) and not target.shape.keyed
        inner = {**bound, variable: target.element if target is not None and listed else None}
        for body in bodies:
            value = self.read(body, inner)
            if name != "filter":
                _whole(value)
        return target if name == "filter" and listed else None

    def _operation(
        self, sign: str, operands: tuple[SyntaxNode, ...], bound: Mapping[str, _Value]
    ) -> _Value:
        if sign in ("==", "!=") and Constant("null") in operands:
            for operand in operands:
                self.read(operand, bound)
            return None
        if sign == "in":
            self._read_whole(operands[:1], bound)
            among = self.read(operands[1], bound)
            if among is not None and not (isinstance(among.shape, Many) and among.shape.keyed):
                _whole(among)
            return None
        self._read_whole(operands, bound)
        return None

    def _count(self, value: _Value) -> None:
        """Note that `value` is counted or gone through: of a record, that reads every field."""
        if value is not None and value.element is None:
            _whole(value)

    def _read_whole(self, nodes: Iterable[SyntaxNode], bound: Mapping[str, _Value]) -> None:
        for node in nodes:
            _whole(self.read(node, bound))
