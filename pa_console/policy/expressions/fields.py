"""The fields that an expression reads of its variables; no other fields are converted.

Converting a value for CEL takes longer than deciding most rules, and a loop copies each element
with all its content. So a record is passed without the fields that the expression cannot notice. An
expression notices a field if it names the field. It notices all fields of a record if it compares
the record with another one, counts or looks up its keys, selects a field by a computed name, or
yields the record. Other fields go unnoticed if it only selects a field, takes the record as an
element of a loop, or compares it with null. In case of doubt, all fields count as read.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from pa_console.policy.expressions.syntax import LOOPS, ExpressionToken

Fields = Mapping[str, "Fields | None"]
"""Fields by name, each with those of its own fields that are read; None means all. For a list or
map, they are the fields of its elements."""

_LEVELS = (("||",), ("&&",), ("<", "<=", ">", ">=", "==", "!=", "in"), ("+", "-"), ("*", "/", "%"))
"""Operators with two operands, lowest precedence first."""

_COMMA = ExpressionToken("sign", ",")


@dataclass(frozen=True)
class Record:
    """A value with fixed fields."""

    fields: "Mapping[str, Shape]"


@dataclass(frozen=True)
class Many:
    """A list of records, or a map from names to records."""

    of: Record
    keyed: bool = False


Shape = Record | Many | None
"""The structure of a value; None for a value without records, which is always passed whole."""

Shapes = Mapping[str, Shape]


def flat(names: Iterable[str]) -> Record:
    """Return a record whose fields contain no records."""
    return Record(dict.fromkeys(names))


def everything(names: Iterable[str]) -> Fields:
    """Return the variables `names` with all their fields."""
    return dict.fromkeys(names)


def united(parts: Iterable[Fields]) -> Fields:
    """Return the union of the fields that `parts` read."""
    merged: dict[str, Fields | None] = {}
    for part in parts:
        for name, inner in part.items():
            fields = merged.get(name, {})
            merged[name] = None if fields is None or inner is None else united((fields, inner))
    return merged


def within(fields: Fields | None, name: str) -> Fields | None:
    """Return the fields that are read of the field `name`, which is one of `fields`."""
    return None if fields is None else fields[name]


def names_of(fields: Fields | None, every: Iterable[str]) -> Iterable[str]:
    """Return the names of the `fields`; `every` name if all are read."""
    return every if fields is None else fields


def fields_read(tokens: Sequence[ExpressionToken], shapes: Shapes) -> Fields:
    """Return the fields of the variables in `shapes` that the expression `tokens` reads.

    Raises NotUnderstoodError if they cannot be determined; the expression may still be valid CEL.
    """
    roots = {name: _ReadValue(shape) for name, shape in shapes.items()}
    reader = _FieldReader(tokens, roots)
    _whole(reader.expression())
    reader.end()
    return {name: roots[name].fields() for name in reader.named}


class NotUnderstoodError(Exception):
    """An expression whose values cannot be traced."""


@dataclass
class _ReadValue:
    """A value passed to an expression, and the parts of it that have been read."""

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
        """Return the field `name`; None if it does not exist or is a plain value."""
        if not isinstance(self.shape, Record) or name not in self.shape.fields:
            return None
        return self.parts.setdefault(name, _ReadValue(self.shape.fields[name]))


_Value = _ReadValue | None
"""The record or list behind a value; None for a plain value or a value that is read as a whole."""


def _whole(*values: _Value) -> None:
    """Mark `values` as read completely."""
    for value in values:
        if value is not None:
            value.whole = True
            _whole(value.element)


def _count(value: _Value) -> None:
    """Mark `value` as counted or iterated over; every field of a record is then read."""
    if value is not None and value.element is None:
        _whole(value)


_NULL = _ReadValue(None)
"""The constant null; comparing a record with it reads nothing."""


class _FieldReader:
    """A parser of CEL, with its precedence rules, that traces the values without building a tree.

    `named` are the variables in the expression. The limit on nested brackets also limits the depth
    of recursion.
    """

    def __init__(self, tokens: Sequence[ExpressionToken], roots: Mapping[str, _ReadValue]) -> None:
        self._tokens, self._at, self._roots = tokens, 0, roots
        self._bound: dict[str, _Value] = {}
        """The elements of the enclosing loops, by variable."""
        self.named: set[str] = set()

    def expression(self) -> _Value:
        """Parse an expression and return its value."""
        condition = self._binary(0)
        if not self._take("?"):
            return condition
        yes = self._binary(0)
        self._expect(":")
        _whole(condition, yes, self.expression())
        return None

    def end(self) -> None:
        """Raise NotUnderstoodError if tokens are left."""
        if self._at != len(self._tokens):
            raise NotUnderstoodError(f"{self._tokens[self._at].text!r} is not expected")

    def _binary(self, level: int) -> _Value:
        if level == len(_LEVELS):
            return self._unary()
        value = self._binary(level + 1)
        while (sign := self._sign()) in _LEVELS[level]:
            self._at += 1
            self._operation(sign, value, self._binary(level + 1))
            value = None
        return value

    def _operation(self, sign: str, left: _Value, right: _Value) -> None:
        if sign in ("==", "!=") and (left is _NULL or right is _NULL):
            return
        keyed = right is not None and isinstance(right.shape, Many) and right.shape.keyed
        _whole(left, None if sign == "in" and keyed else right)

    def _unary(self) -> _Value:
        if self._take("!") or self._take("-"):
            _whole(self._unary())
            return None
        return self._member()

    def _member(self) -> _Value:
        value = self._primary()
        while True:
            if self._take("."):
                name = self._name()
                value = self._method(name, value) if self._take("(") else _select(value, name)
            elif self._take("["):
                _whole(self.expression())
                self._expect("]")
                if value is not None and value.element is None:
                    _whole(value)
                value = None if value is None else value.element
            else:
                return value

    def _method(self, name: str, target: _Value) -> _Value:
        if name in LOOPS and self._tokens[self._at + 1 : self._at + 2] == (_COMMA,):
            return self._loop(name, target)
        arguments = self._until(")")
        if name == "size" and not arguments:
            _count(target)
        else:
            _whole(target, *arguments)
        return None

    def _loop(self, name: str, target: _Value) -> _Value:
        """Return the value of a loop over `target`; a loop over a map goes through its keys."""
        _count(target)
        listed = target is not None and isinstance(target.shape, Many) and not target.shape.keyed
        variable, before = self._name(), self._bound
        self._expect(",")
        self._bound = {**before, variable: target.element if target and listed else None}
        bodies = self._until(")")
        self._bound = before
        if len(bodies) not in ((1, 2) if name == "map" else (1,)):
            raise NotUnderstoodError(f"{name}() has other arguments than a loop")
        if name == "filter":
            return target if listed else None
        _whole(*bodies)
        return None

    def _primary(self) -> _Value:
        if self._at == len(self._tokens):
            raise NotUnderstoodError("it ends too early")
        token = self._tokens[self._at]
        self._at += 1
        if token.kind in ("text", "number") or token.text in ("true", "false"):
            return None
        if token.text == "null":
            return _NULL
        if token.kind == "name" and token.text != "in":
            if self._sign() == "{":
                raise NotUnderstoodError("messages are not known")
            return self._call(token.text) if self._take("(") else self._variable(token.text)
        if token.text == "(":
            value = self.expression()
            self._expect(")")
            return value
        if token.text in ("[", "{"):
            _whole(*self._until("]" if token.text == "[" else "}"))
            return None
        raise NotUnderstoodError(f"{token.text!r} is not expected")

    def _call(self, name: str) -> None:
        arguments = self._until(")")
        if name == "size" and len(arguments) == 1:
            _count(arguments[0])
        elif name != "has" or len(arguments) != 1:
            _whole(*arguments)

    def _variable(self, name: str) -> _Value:
        if name in self._bound:
            return self._bound[name]
        if name not in self._roots:
            return None
        self.named.add(name)
        return self._roots[name]

    def _until(self, close: str) -> list[_Value]:
        """Return the parts up to the bracket `close`: arguments, elements, or keys and values."""
        values: list[_Value] = []
        while not self._take(close):
            values.append(self.expression())
            if close == "}":
                self._expect(":")
                values.append(self.expression())
            if self._sign() != close:
                self._expect(",")
        return values

    def _sign(self) -> str:
        """Return the next token if it may be an operator or a bracket, else ''."""
        if self._at == len(self._tokens):
            return ""
        token = self._tokens[self._at]
        return token.text if token.kind == "sign" or token.text == "in" else ""

    def _take(self, sign: str) -> bool:
        matches = self._sign() == sign
        self._at += matches
        return matches

    def _expect(self, sign: str) -> None:
        if not self._take(sign):
            raise NotUnderstoodError(f"{sign!r} is missing")

    def _name(self) -> str:
        if self._at == len(self._tokens) or self._tokens[self._at].kind != "name":
            raise NotUnderstoodError("a name is missing")
        self._at += 1
        return self._tokens[self._at - 1].text


def _select(value: _Value, name: str) -> _Value:
    if value is None:
        return None
    return value.element if isinstance(value.shape, Many) else value.part(name)
