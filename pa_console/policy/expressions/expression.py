"""CEL expressions of rules: compiled once, and checked for names that do not exist.

The time of a search with a regular expression is bounded. RE2 searches ASCII texts, in a time that
is linear in the text for every pattern. Other texts, and patterns with lookahead or lookbehind, are
searched by a backtracking engine that stops at the check's deadline. A pattern means the same to
both engines.
"""

import logging
import re
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from functools import cached_property, lru_cache
from importlib import import_module
from typing import Any, TypeVar

import cel
import regex

from pa_console.policy.expressions.deadlines import (
    DEADLINE_S,
    DeadlineError,
    deadline,
    give_up,
    going_on,
    left_s,
    unmeasured,
)
from pa_console.policy.expressions.fields import (
    Fields,
    NotUnderstoodError,
    Shapes,
    everything,
    fields_read,
)
from pa_console.policy.expressions.forbidden_words import (
    asks_for_force,
    asks_to_confine,
    asks_to_follow,
    asks_to_set_rules_aside,
)
from pa_console.policy.expressions.syntax import GOING_ON, Source

_re2: Any = import_module("re2")
"""The library re2, which has no type information."""

T = TypeVar("T")
MAX_PATTERN = 16_384
MAX_PROGRAM = 12_000
"""The largest number of steps of a pattern in RE2; in the worst case, each step goes through the
text once."""
MAX_TEXT = 10_000
"""The largest length of a text that can be searched, in characters; a mission has at most 2,000."""

_ESCAPED_OR_CLASS = re.compile(r"\\(?s:.)|\[\^?\]?(?:\\(?s:.)|[^\]\\])*\]|\s+|#[^\n]*")
_LOOKS = re.compile(r"(\\(?s:.)|\[\^?\]?(?:\\(?s:.)|[^\]\\])*\])|\(\?<?[=!]")
_VERBOSE = re.compile(r"\s*\(\?x\)")

PLAN_VARIABLES: frozenset[str] = frozenset(
    ("plan", "actions", "before", "after", "timeline", "tracks", "assets", "gates", "mission",
     "world", "sightings")
)  # fmt: skip
"""The variables of a guard or a check, described in `policy.rule_variables`."""

MOMENT_VARIABLES: frozenset[str] = frozenset(("now", "world"))
SUBJECT_VARIABLES: frozenset[str] = MOMENT_VARIABLES | {"it", "id"}
"""The variables of an ordering, without and with `each`, described in `policy.orderings`."""

WORKFLOW_VARIABLES: frozenset[str] = frozenset(("now", "it", "id", "steady_s"))
"""The variables of a workflow, described in `policy.orderings`."""

STANDARD_FUNCTIONS: frozenset[str] = frozenset(
    ("contains", "double", "endsWith", "has", "int", "matches", "size", "startsWith", "string")
)


class Pattern:
    """A compiled pattern; raises ValueError, with the reason, if it is not supported."""

    def __init__(self, source: str) -> None:
        """Compile `source` for RE2; for the other engine it is compiled when needed."""
        if len(source) > MAX_PATTERN:
            raise ValueError(f"too long: {len(source):,} characters, at most {MAX_PATTERN:,}")
        try:
            re.compile(source)
        except (re.error, RecursionError, OverflowError) as error:
            raise ValueError(f"not a regular expression: {error}") from error
        plain = _without_layout(source)
        looking = _LOOKS.sub(lambda match: match[1] or "(?:", plain)
        linear = _linear(looking)
        self._linear = linear if looking == plain else None
        self._source = source

    @cached_property
    def _any(self) -> regex.Pattern[str]:
        """The pattern for the backtracking engine, which most texts do not need."""
        with unmeasured():
            return regex.compile(self._source)

    def prepare(self) -> None:
        """Compile the pattern for the backtracking engine now."""
        _ = self._any

    def search(self, text: str) -> bool:
        """Return whether the pattern matches somewhere in `text`."""
        left = _left(text)
        if self._linear is not None and text.isascii():
            return self._linear.search(text) is not None
        search = self._any.search
        return _in_time(
            lambda limit: search(text, concurrent=False, timeout=limit) is not None, left
        )

    def cut(self, text: str, mark: str) -> str:
        """Return `text` with every match replaced by `mark`."""
        left = _left(text)
        if self._linear is not None and text.isascii():
            return str(self._linear.sub(mark, text))
        cut = self._any.sub
        return _in_time(lambda limit: cut(mark, text, concurrent=False, timeout=limit), left)


@lru_cache(maxsize=1024)
def compiled_pattern(source: str) -> Pattern:
    """Return the pattern `source`, compiled once; raises ValueError if it is not supported."""
    return Pattern(source)


def _linear(source: str) -> Any:
    """Return `source` compiled by RE2; raises ValueError for features that RE2 does not support."""
    options = _re2.Options()
    options.log_errors = False
    try:
        compiled = _re2.compile(source.replace(r"\Z", r"\z"), options)
    except _re2.error as error:
        problem = error.args[0].decode() if error.args else "not supported"
        raise ValueError(
            f"{problem}: backreferences, possessive and atomic groups, conditions and very large "
            "repetitions are not supported"
        ) from error
    if compiled.programsize > MAX_PROGRAM:
        raise ValueError(
            f"too large: {compiled.programsize:,} steps, at most {MAX_PROGRAM:,}; "
            "repeat less, or split the pattern"
        )
    return compiled


def _left(text: str) -> float | None:
    """Return the seconds left for a search of `text`; None without a limit.

    Raises ValueError if the text is too long, and DeadlineError if no time is left.
    """
    if len(text) > MAX_TEXT:
        raise ValueError(f"a text of {len(text):,} characters is too long to search")
    left = left_s()
    if left == 0.0:
        raise DeadlineError("no time is left for a pattern")
    return left


def _in_time(search: Callable[[float | None], T], left: float | None) -> T:
    """Return the result of `search` within `left` seconds; raises DeadlineError if it takes longer.

    The engine counts the processor time of all threads, so a search that it stopped before this
    thread's own time was used up is repeated. The search keeps the interpreter's lock. If it
    released the lock, it would have to acquire it again every few steps; if another thread is busy,
    this takes a hundred times as long as the search.
    """
    while True:
        try:
            return search(left)
        except TimeoutError as error:
            left = left_s()
            if not left:
                give_up()
                raise DeadlineError("a pattern took too long") from error


def _without_layout(source: str) -> str:
    """Return a verbose pattern without its spaces and comments, which RE2 does not support."""
    begins = _VERBOSE.match(source)
    if begins is None:
        return source
    return _ESCAPED_OR_CLASS.sub(
        lambda match: match[0] if match[0][0] in "\\[" else "", source[begins.end() :]
    )


_log = logging.getLogger("cel")
_log.propagate = False
_log.addHandler(logging.NullHandler())
# A failed expression becomes the finding of its rule; the library would also print it.


def finds(text: str, pattern: str) -> bool:
    """Return whether the regular expression `pattern` matches somewhere in `text`.

    It replaces CEL's own `matches`, which compiles its pattern again at each call.
    """
    return compiled_pattern(pattern).search(text)


def without(text: str, pattern: str) -> str:
    """Return `text` with every match of the regular expression `pattern` cut out.

    To express "... but not in such a phrase", cut out those phrases first. A comma replaces each
    phrase, so that its neighbours do not join.
    """
    return compiled_pattern(pattern).cut(text, " , ")


def brief(number: float) -> str:
    """Return `number` as text for a message, with at most four significant digits."""
    return f"{number:.4g}"


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "asks_for_force": asks_for_force,
    "asks_to_confine": asks_to_confine,
    "asks_to_follow": asks_to_follow,
    "asks_to_set_rules_aside": asks_to_set_rules_aside,
    "brief": brief,
    "finds": finds,
    "without": without,
    GOING_ON: going_on,
}
"""Functions that expressions may use in addition to CEL's own."""


class Expression:
    """A compiled CEL expression; `variables` are the allowed variables that it reads."""

    def __init__(
        self, source: str, allowed: frozenset[str] = PLAN_VARIABLES, deadline_s: float = DEADLINE_S
    ) -> None:
        """Compile `source`, which may take `deadline_s` of processor time at each evaluation.

        Raises ValueError for broken syntax, unknown names, unsupported patterns and excessive size.
        """
        text = Source(source)
        try:
            self._patterns = [compiled_pattern(pattern) for pattern in text.patterns()]
        except ValueError as error:
            raise ValueError(f"a pattern that cannot be used: {error}") from error
        self._program = _compiled(source, text)
        self._deadline_s = deadline_s
        references = self._program.references()
        named = set(references["variables"])
        unknown = sorted(named - text.bound - allowed)
        if unknown:
            names = ", ".join(sorted(allowed))
            raise ValueError(f"unknown name {unknown[0]!r}; an expression may use {names}")
        functions = {name for name in references["functions"] if name.isidentifier()}
        missing = sorted(functions - STANDARD_FUNCTIONS - FUNCTIONS.keys())
        if missing:
            names = ", ".join(sorted(STANDARD_FUNCTIONS | FUNCTIONS.keys() - {GOING_ON}))
            raise ValueError(f"unknown function {missing[0]!r}; known: {names}")
        if GOING_ON in source:
            raise ValueError(f"a rule may not use {GOING_ON!r}")
        self.variables: frozenset[str] = allowed & named
        self.size = text.size
        """The number of tokens in the expression."""
        self._tokens = text.tokens
        self._read: tuple[Shapes, Fields] | None = None

    def prepare(self) -> None:
        """Compile the patterns for the texts that RE2 cannot search."""
        for pattern in self._patterns:
            pattern.prepare()

    def reads(self, shapes: Shapes) -> Fields:
        """Return the fields that the expression can notice of its variables, described by `shapes`.

        The result is cached for the same `shapes`.
        """
        if self._read is None or self._read[0] is not shapes:
            self._read = shapes, self._find_reads(shapes)
        return self._read[1]

    def _find_reads(self, shapes: Shapes) -> Fields:
        try:
            return fields_read(self._tokens, shapes)
        except (NotUnderstoodError, RecursionError):
            return everything(self.variables)

    def evaluate(self, context: cel.Context) -> Any:
        """Return the value in `context`; errors of the expression are raised.

        Raises DeadlineError if it takes too long.
        """
        with deadline(self._deadline_s), _no_panic():
            return self._program.execute(context)


def make_context(variables: Mapping[str, Any]) -> cel.Context:
    """Convert `variables` once, for any number of expressions."""
    return cel.Context(variables=dict(variables), functions=dict(FUNCTIONS))


@contextmanager
def _no_panic() -> Generator[None]:
    """Turn a panic of the library, which `except Exception` does not catch, into a ValueError."""
    try:
        yield
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        raise ValueError(f"the expression library failed: {error}") from None


def _compiled(source: str, text: Source) -> cel.Program:
    """Return the program of an expression; errors give their positions in `source`."""
    problem = text.problem
    try:
        if not problem:
            with _no_panic():
                return cel.compile(text.watched())
    except ValueError as error:
        problem = _syntax_problem(error)
    try:
        with _no_panic():
            cel.compile(source)
    except ValueError as error:
        problem = _syntax_problem(error)
    raise ValueError(f"not valid CEL: {problem}")


def _syntax_problem(error: ValueError) -> str:
    """Return the parser's complaint without the expression that it repeats."""
    match = re.search(r"<input>:(\d+):(\d+): (.*)", str(error))
    if match is None:
        return str(error).splitlines()[0]
    return f"line {match[1]}, column {match[2]}: {match[3].split(' expecting ')[0]}"
