"""The text of a CEL expression: its tokens, its limits, and loops that observe a time limit.

The parser is recursive, and a running expression cannot be stopped from outside. So an expression
is refused before it is parsed if it is too large or too deep, or if its values could grow too
large, and every loop checks at each round whether time is left.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cel

MAX_CHARACTERS = 32_768
MAX_TOKENS = 800
MAX_NESTING = 24
MAXLOOPS = 4
"""The limit on nested loops; the shipped rules nest at most three."""
MAX_VALUE = 1_000_000
"""The largest value that an expression may be able to build, in characters or elements."""
INPUT_SIZE = 2_000
"""The assumed size of an input value, in characters or elements; a mission has at most 2,000
characters."""

GOING_ON = "__going_on"
"""The function that a loop calls at each round to check the time left."""

Kind = Literal["space", "text", "number", "name", "sign"]

LOOPS = {"all": "false", "exists": "true", "exists_one": "false", "existsOne": "false",
          "filter": "false", "map": "null"}  # fmt: skip
"""The macros that loop, each with the result of a round that ends the loop when no time is left."""
_PATTERNED = ("finds", "without", "matches")
_OPEN, _CLOSE = "([{", ")]}"
_TOKEN = re.compile(
    r"""(?x)
    (?P<space> (?: \s | //[^\n]* )+ )
  | (?P<text> (?: [rR][bB]? | [bB][rR] ) (?: \"{3} (?s:.*?) \"{3} | '{3} (?s:.*?) '{3}
        | "[^"\n\r]*" | '[^'\n\r]*' )
      | [bB]? (?: \"{3} (?: \\(?s:.) | [^\\] )*? \"{3} | '{3} (?: \\(?s:.) | [^\\] )*? '{3}
        | " (?: \\. | [^"\\\n\r] )* " | ' (?: \\. | [^'\\\n\r] )* ' ) )
  | (?P<number> (?: 0[xX][0-9a-fA-F]+ | \.?[0-9] [0-9.]* (?: [eE][+-]?[0-9]+ )? ) [uU]? )
  | (?P<name> [A-Za-z_][A-Za-z0-9_]* )
  | (?P<sign> && | \|\| | == | != | <= | >= | [-+*/%<>!?:.,()\[\]{}] )
    """
)

_BEFORE_VALUE = frozenset(("(", "[", "{", ",", ":", "?", "&&", "||", "!", "+", "-", "*", "/", "%",
                           "==", "!=", "<", ">", "<=", ">=", "in"))  # fmt: skip


@dataclass(frozen=True)
class ExpressionToken:
    """A token of the source; `close` is the place of the bracket that closes an opening one."""

    kind: Kind
    text: str
    close: int = -1


@dataclass(frozen=True)
class Loop:
    """One loop: the place of its opening bracket, and of the first and last token of its body."""

    name: str
    variable: str
    opening: int
    first: int
    last: int


class Source:
    """The text of an expression within the limits; raises ValueError otherwise."""

    def __init__(self, text: str) -> None:
        """Parse `text`; if brackets do not match, it has no tokens and `problem` has the reason."""
        if len(text) > MAX_CHARACTERS:
            raise ValueError(
                f"too long: {len(text):,} characters, at most {MAX_CHARACTERS:,}; split the rule"
            )
        self._tokens, self.problem = _matched(_tokens(text))
        self._loops = tuple(self._find_loops())
        self._refuse_nested_loops()
        self._refuse_growth()

    @property
    def tokens(self) -> tuple[ExpressionToken, ...]:
        """The tokens of the expression."""
        return tuple(self._tokens)

    @property
    def size(self) -> int:
        """The number of tokens."""
        return len(self._tokens)

    @property
    def bound(self) -> frozenset[str]:
        """The names that loops bind."""
        return frozenset(loop.variable for loop in self._loops)

    def patterns(self) -> Iterator[str]:
        """Yield every regular expression; raises ValueError for one that is not a literal."""
        for place, token in enumerate(self._tokens):
            if token.text not in _PATTERNED or not self._is_call(place):
                continue
            opening = place + 1
            *_, (first, last) = self._arguments(opening)
            if first != last or self._tokens[first].kind != "text":
                raise ValueError(
                    f"the pattern of {token.text}() must be written out as one quoted text"
                )
            yield str(cel.evaluate(self._tokens[first].text))

    def watched(self) -> str:
        """Return the same expression with loops that end when no time is left."""
        before: dict[int, str] = {}
        after: dict[int, str] = {}
        for loop in self._loops:
            ended = LOOPS[loop.name]
            before[loop.first] = before.get(loop.first, "") + f"{GOING_ON}() ? ("
            after[loop.last] = f") : {ended}" + after.get(loop.last, "")
        words: list[str] = []
        for place, token in enumerate(self._tokens):
            call = token.text == "matches" and self._is_call(place)
            words += [before.get(place, ""), "finds" if call else token.text, after.get(place, "")]
        return " ".join(word for word in words if word)

    def _is_call(self, place: int) -> bool:
        tokens = self._tokens
        return tokens[place].kind == "name" and tokens[place + 1 : place + 2] != [] and (
            tokens[place + 1].text == "("
        )  # fmt: skip

    def _arguments(self, opening: int) -> list[tuple[int, int]]:
        """Return the first and last place of every argument in the brackets at `opening`."""
        places: list[tuple[int, int]] = []
        first = place = opening + 1
        close = self._tokens[opening].close
        while place <= close:
            if place == close or self._tokens[place].text == ",":
                places.append((first, place - 1))
                first = place + 1
            elif self._tokens[place].close > place:
                place = self._tokens[place].close
            place += 1
        return places

    def _find_loops(self) -> Iterator[Loop]:
        for place, token in enumerate(self._tokens):
            method = place > 0 and self._tokens[place - 1].text == "."
            if not method or token.text not in LOOPS or not self._is_call(place):
                continue
            arguments = self._arguments(place + 1)
            if len(arguments) not in ((2, 3) if token.text == "map" else (2,)):
                continue
            (name, name_end), (first, last) = arguments[:2]
            if name != name_end or self._tokens[name].kind != "name":
                raise ValueError(f"{token.text}() needs a plain name as its loop variable")
            if last < first:
                raise ValueError(f"not valid CEL: an argument of {token.text}() is missing")
            kind = "filter" if len(arguments) == 3 else token.text
            yield Loop(kind, self._tokens[name].text, place + 1, first, last)

    def _refuse_nested_loops(self) -> None:
        closes: list[int] = []
        for loop in self._loops:
            closes = [close for close in closes if close > loop.opening]
            closes.append(self._tokens[loop.opening].close)
            if len(closes) > MAXLOOPS:
                raise ValueError(f"loops are nested deeper than {MAXLOOPS}; split the rule")

    def _refuse_growth(self) -> None:
        """Refuse an expression that could build a huge value, since loops can build on each other.

        A value grows by `+`, and if it is named several times in a list or map. Between two loops,
        it can grow at most by a factor of 1 plus the number of such operators and names.
        """
        signs = [0] * (len(self._loops) + 1)
        within: list[tuple[int, int]] = []
        starts = {loop.opening: number for number, loop in enumerate(self._loops, start=1)}
        listing = [False]
        for place, token in enumerate(self._tokens):
            if place in starts:
                within.append((token.close, starts[place]))
            if token.close > place:
                value = place == 0 or self._tokens[place - 1].text in _BEFORE_VALUE
                listing.append(token.text == "{" or (token.text == "[" and value))
            elif token.text in _CLOSE:
                listing.pop()
            if within and within[-1][0] == place:
                within.pop()
            if token.text == "+" or (token.text == "," and listing[-1] and not self._plain(place)):
                signs[within[-1][1] if within else 0] += 1
        texts = (len(token.text) for token in self._tokens if token.kind == "text")
        size = INPUT_SIZE + max(texts, default=0)
        for count in signs:
            size *= 1 + count
        if size > MAX_VALUE:
            raise ValueError(
                f"its values could grow to {size:,} characters, at most {MAX_VALUE:,}: "
                "use fewer + in loops that follow each other, or split the rule"
            )

    def _plain(self, place: int) -> bool:
        """Return whether the list element before the comma at `place` is a literal."""
        tokens = self._tokens
        return tokens[place - 1].kind in ("text", "number") and tokens[place - 2].text in "[,"


def _tokens(text: str) -> list[ExpressionToken]:
    tokens: list[ExpressionToken] = []
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            line = text.count("\n", 0, place) + 1
            column = place - text.rfind("\n", 0, place)
            raise ValueError(f"not valid CEL: line {line}, column {column}: {text[place]!r}")
        place = match.end()
        kind = match.lastgroup
        if kind != "space":
            tokens.append(ExpressionToken(kind, match[0]))  # pyright: ignore[reportArgumentType] - a group's
            if len(tokens) > MAX_TOKENS:
                raise ValueError(
                    f"too large: more than {MAX_TOKENS} names, values and signs; split the rule"
                )
    return tokens


def _matched(tokens: list[ExpressionToken]) -> tuple[list[ExpressionToken], str]:
    """Return the tokens, in which each opening bracket has the place of its closing one.

    If brackets do not match, the result has no tokens and a description of the problem.
    """
    matched = list(tokens)
    waiting: list[int] = []
    for place, token in enumerate(tokens):
        if token.kind != "sign":
            continue
        if token.text in _OPEN:
            waiting.append(place)
            if len(waiting) > MAX_NESTING:
                raise ValueError(f"brackets are nested deeper than {MAX_NESTING}; split the rule")
        elif token.text in _CLOSE:
            if not waiting or _OPEN.index(tokens[waiting[-1]].text) != _CLOSE.index(token.text):
                return [], f"{token.text!r} closes nothing"
            opening = waiting.pop()
            matched[opening] = ExpressionToken("sign", tokens[opening].text, place)
    if waiting:
        return [], f"{tokens[waiting[-1]].text!r} is not closed"
    return matched, ""
