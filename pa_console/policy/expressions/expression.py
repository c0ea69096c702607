"""CEL expressions of rules: compiled once, and searched for names that do not exist."""

import logging
import re
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any

import cel

from pa_console.policy.checks.forbidden_words import (
    asks_for_force,
    asks_to_confine,
    asks_to_set_rules_aside,
)
from pa_console.policy.expressions import patterns
from pa_console.policy.expressions.deadlines import DEADLINE_S, deadline, going_on
from pa_console.policy.expressions.fields import Fields, Shapes, everything, fields_read
from pa_console.policy.expressions.source_limits import GOING_ON, Source
from pa_console.policy.expressions.syntax import SyntaxTreeError, syntax_tree

_log = logging.getLogger("cel")
_log.propagate = False
_log.addHandler(logging.NullHandler())
# An expression that fails is told as the finding of its rule; the library would print it too.

PLAN_VARIABLES: frozenset[str] = frozenset(
    ("plan", "actions", "before", "after", "timeline", "tracks", "assets", "gates", "mission",
     "world", "sightings")
)  # fmt: skip
"""The variables of a guard or a check; `policy.context` describes them."""

MOMENT_VARIABLES: frozenset[str] = frozenset(("now", "world"))
SUBJECT_VARIABLES: frozenset[str] = MOMENT_VARIABLES | {"it", "id"}
"""The variables of an ordering, without and with `each`; `policy.subjects` describes them."""

WORKFLOW_VARIABLES: frozenset[str] = frozenset(("now", "it", "id", "steady_s"))
"""The variables of a workflow; `policy.workflow` describes them."""

STANDARD_FUNCTIONS: frozenset[str] = frozenset(
    ("contains", "double", "endsWith", "has", "int", "matches", "size", "startsWith", "string")
)


def finds(text: str, pattern: str) -> bool:
    """Return whether the regular expression `pattern` matches somewhere in `text`.

    CEL's own `matches` is taken for it, for that compiles its pattern anew each time.
    """
    return patterns.pattern(pattern).search(text)


def without(text: str, pattern: str) -> str:
    """Return `text` with every match of the regular expression `pattern` cut out.

    "... but not in such a phrase" is said by cutting those phrases out first. A comma stays where
    a phrase was, so that its neighbours do not join.
    """
    return patterns.pattern(pattern).cut(text, " , ")


def brief(number: float) -> str:
    """Return `number` as a person writes it in a message, with at most four digits."""
    return f"{number:.4g}"


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "asks_for_force": asks_for_force,
    "asks_to_confine": asks_to_confine,
    "asks_to_set_rules_aside": asks_to_set_rules_aside,
    "brief": brief,
    "finds": finds,
    "without": without,
    GOING_ON: going_on,
}
"""Functions that expressions may use besides CEL's own."""


class Expression:
    """A compiled CEL expression; `variables` are those of the allowed ones that it reads."""

    def __init__(
        self,
        source: str,
        allowed: frozenset[str] = PLAN_VARIABLES,
        deadline_s: float = DEADLINE_S,
    ) -> None:
        """Compile `source`, which may run `deadline_s` of processor time each time.

        Raises ValueError for broken syntax, for unknown names, for patterns that are not supported
        and for what is too large.
        """
        text = Source(source)
        for pattern in text.patterns():
            try:
                patterns.pattern(pattern)
            except ValueError as error:
                raise ValueError(f"a pattern that cannot be used: {error}") from error
        self._program = _compiled(source, text)
        self._deadline_s = deadline_s
        references = self._program.references()
        named = set(references["variables"])
        unknown = sorted(named - text.bound - allowed)
        if unknown:
            known = ", ".join(sorted(allowed))
            raise ValueError(f"unknown name {unknown[0]!r}; an expression may use {known}")
        functions = {name for name in references["functions"] if name.isidentifier()}
        missing = sorted(functions - STANDARD_FUNCTIONS - FUNCTIONS.keys())
        if missing:
            known = ", ".join(sorted(STANDARD_FUNCTIONS | FUNCTIONS.keys() - {GOING_ON}))
            raise ValueError(f"unknown function {missing[0]!r}; known: {known}")
        if GOING_ON in source:
            raise ValueError(f"{GOING_ON!r} is not for rules to use")
        self.variables: frozenset[str] = allowed & named
        self.size = text.size
        """The number of names, values and signs in it."""
        self._tokens = text.tokens
        self._read: tuple[Shapes, Fields] | None = None

    def reads(self, shapes: Shapes) -> Fields:
        """Return which fields of its variables, which `shapes` describes, it can notice.

        It is found out once, for the same `shapes`.
        """
        if self._read is None or self._read[0] is not shapes:
            self._read = shapes, self._find_reads(shapes)
        return self._read[1]

    def _find_reads(self, shapes: Shapes) -> Fields:
        try:
            return fields_read(syntax_tree(self._tokens), shapes)
        except (SyntaxTreeError, RecursionError):
            return everything(self.variables)

    def evaluate(self, context: cel.Context) -> Any:
        """Return the value in `context`; raises whatever the expression runs into.

        Raises DeadlineError when it takes too long.
        """
        with deadline(self._deadline_s), _no_panic():
            return self._program.execute(context)


def make_context(variables: Mapping[str, Any]) -> cel.Context:
    """Convert `variables` once, for any number of expressions."""
    return cel.Context(variables=dict(variables), functions=dict(FUNCTIONS))


@contextmanager
def _no_panic() -> Generator[None]:
    """Make a panic of the library, which no handler of exceptions sees, a ValueError."""
    try:
        yield
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        raise ValueError(f"the expression language broke down: {error}") from None


def _compiled(source: str, text: Source) -> cel.Program:
    """Return the program of an expression; its errors name their places in `source`."""
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
    found = re.search(r"<input>:(\d+):(\d+): (.*)", str(error))
    if found is None:
        return str(error).splitlines()[0]
    return f"line {found[1]}, column {found[2]}: {found[3].split(' expecting ')[0]}"
