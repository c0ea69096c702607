"""The syntax tree of a CEL expression: what is done to which value, in CEL's precedence.

The library that evaluates expressions does not show its own. This one is for what is asked of a
rule before it runs; nothing is evaluated by it. What it does not know it refuses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pa_console.policy.expressions.source_limits import Token

_LEVELS: tuple[frozenset[str], ...] = (
    frozenset(("||",)),
    frozenset(("&&",)),
    frozenset(("<", "<=", ">", ">=", "==", "!=", "in")),
    frozenset(("+", "-")),
    frozenset(("*", "/", "%")),
)
"""Operators with two operands, the loosest first."""

_KEYWORDS = ("true", "false", "null", "in")


class SyntaxTreeError(Exception):
    """An expression without a known tree; it may be valid CEL all the same."""


@dataclass(frozen=True)
class Literal:
    """A text, a number, true, false or null."""

    text: str


@dataclass(frozen=True)
class Variable:
    """A variable, or what a loop binds."""

    name: str


@dataclass(frozen=True)
class Select:
    """`of.field`."""

    of: "Node"
    field: str


@dataclass(frozen=True)
class Index:
    """`of[at]`."""

    of: "Node"
    at: "Node"


@dataclass(frozen=True)
class Call:
    """`name(...)`, or `target.name(...)`; a loop is one too."""

    name: str
    target: "Node | None"
    arguments: tuple["Node", ...]


@dataclass(frozen=True)
class Operation:
    """An operator and its operands: one, two, or three for `?`."""

    sign: str
    operands: tuple["Node", ...]


@dataclass(frozen=True)
class Listing:
    """A list that is written out; `sign` is `{` for a map, whose keys and values are `items`."""

    sign: str
    items: tuple["Node", ...]


Node = Literal | Variable | Select | Index | Call | Operation | Listing


def syntax_tree(tokens: Sequence[Token]) -> Node:
    """Return the tree of an expression; raises SyntaxTreeError where it is not understood."""
    parser = _Parser(tokens)
    tree = parser.expression()
    parser.end()
    return tree


class _Parser:
    """Reads tokens from left to right; how deep it recurses is bounded as their brackets are."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self._tokens, self._at = tokens, 0

    def expression(self) -> Node:
        condition = self._binary(0)
        if not self._take("?"):
            return condition
        yes = self._binary(0)
        self._expect(":")
        return Operation("?", (condition, yes, self.expression()))

    def end(self) -> None:
        if self._at != len(self._tokens):
            raise SyntaxTreeError(f"{self._tokens[self._at].text!r} is not expected")

    def _binary(self, level: int) -> Node:
        if level == len(_LEVELS):
            return self._unary()
        found = self._binary(level + 1)
        while (sign := self._sign()) in _LEVELS[level]:
            self._at += 1
            found = Operation(sign, (found, self._binary(level + 1)))
        return found

    def _unary(self) -> Node:
        signs: list[str] = []
        while (sign := self._sign()) in ("!", "-"):
            self._at += 1
            signs.append(sign)
        found = self._member()
        for sign in reversed(signs):
            found = Operation(sign, (found,))
        return found

    def _member(self) -> Node:
        found = self._primary()
        while True:
            if self._take("."):
                name = self._name()
                if self._take("("):
                    found = Call(name, found, self._until(")"))
                else:
                    found = Select(found, name)
            elif self._take("["):
                found = Index(found, self.expression())
                self._expect("]")
            else:
                return found

    def _primary(self) -> Node:
        if self._at == len(self._tokens):
            raise SyntaxTreeError("it ends too early")
        token = self._tokens[self._at]
        self._at += 1
        if token.kind in ("text", "number") or token.text in ("true", "false", "null"):
            return Literal(token.text)
        if token.kind == "name" and token.text not in _KEYWORDS:
            if self._sign() == "{":
                raise SyntaxTreeError("messages are not known")
            return (
                Call(token.text, None, self._until(")"))
                if self._take("(")
                else Variable(token.text)
            )
        if token.text == "(":
            found = self.expression()
            self._expect(")")
            return found
        if token.text == "[":
            return Listing("[", self._until("]"))
        if token.text == "{":
            return Listing("{", self._until("}"))
        raise SyntaxTreeError(f"{token.text!r} is not expected")

    def _until(self, close: str) -> tuple[Node, ...]:
        """Return the parts up to the bracket `close`: arguments, elements, or keys and values."""
        found: list[Node] = []
        while not self._take(close):
            found.append(self.expression())
            if close == "}":
                self._expect(":")
                found.append(self.expression())
            if self._sign() != close:
                self._expect(",")
        return tuple(found)

    def _sign(self) -> str:
        """Return the next token where it may be an operator or a bracket, else ''."""
        if self._at == len(self._tokens):
            return ""
        token = self._tokens[self._at]
        return token.text if token.kind == "sign" or token.text == "in" else ""

    def _take(self, sign: str) -> bool:
        found = self._sign() == sign
        self._at += found
        return found

    def _expect(self, sign: str) -> None:
        if not self._take(sign):
            raise SyntaxTreeError(f"{sign!r} is missing")

    def _name(self) -> str:
        if self._at == len(self._tokens) or self._tokens[self._at].kind != "name":
            raise SyntaxTreeError("a field has no plain name")
        self._at += 1
        return self._tokens[self._at - 1].text
