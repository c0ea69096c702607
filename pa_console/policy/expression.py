"""CEL expressions of rules: compiled once, and searched for names that do not exist."""

import re
from collections.abc import Mapping
from typing import Any

import cel

from pa_console.policy.forbidden_words import asks_for_force, asks_to_set_rules_aside

PLAN_VARIABLES: frozenset[str] = frozenset(
    ("plan", "actions", "before", "after", "timeline", "tracks", "assets", "gates", "mission",
     "world", "sightings")
)  # fmt: skip
"""What a guard or a check may speak of; `policy.context` says what each holds."""

MOMENT_VARIABLES: frozenset[str] = frozenset(("now", "world"))
SUBJECT_VARIABLES: frozenset[str] = MOMENT_VARIABLES | {"it", "id"}
"""What an ordering may speak of, without and with `each`; `policy.subjects` says what they hold."""

WORKFLOW_VARIABLES: frozenset[str] = frozenset(("now", "it", "id", "steady_s"))
"""What a workflow may speak of; `policy.workflow` says what each holds."""

STANDARD_FUNCTIONS: frozenset[str] = frozenset(
    ("contains", "double", "endsWith", "has", "int", "matches", "size", "startsWith", "string")
)

_BOUND = re.compile(r"\.\s*(?:all|exists|exists_one|filter|map)\s*\(\s*(\w+)\s*,")


def finds(text: str, pattern: str) -> bool:
    """Return whether the regular expression `pattern` matches somewhere in `text`.

    CEL's own `matches` compiles its pattern anew each time; Python keeps it.
    """
    return re.search(pattern, text) is not None


def without(text: str, pattern: str) -> str:
    """Return `text` with every match of the regular expression `pattern` cut out.

    "... but not in such a phrase" is said by cutting those phrases out first. A comma stays where
    a phrase was, so that its neighbours do not join.
    """
    return re.sub(pattern, " , ", text)


def brief(number: float) -> str:
    """Return `number` as a person writes it in a message, with at most four digits."""
    return f"{number:.4g}"


FUNCTIONS = {
    "asks_for_force": asks_for_force,
    "asks_to_set_rules_aside": asks_to_set_rules_aside,
    "brief": brief,
    "finds": finds,
    "without": without,
}
"""Functions that expressions may use besides CEL's own."""


class Expression:
    """A compiled CEL expression; `variables` are those of the allowed ones that it reads."""

    def __init__(self, source: str, allowed: frozenset[str] = PLAN_VARIABLES) -> None:
        """Compile `source`; raises ValueError for broken syntax and for unknown names."""
        try:
            self._program = cel.compile(source)
        except ValueError as error:
            raise ValueError(f"not valid CEL: {_syntax_problem(error)}") from error
        references = self._program.references()
        named = set(references["variables"])
        unknown = sorted(named - set(_BOUND.findall(source)) - allowed)
        if unknown:
            known = ", ".join(sorted(allowed))
            raise ValueError(f"unknown name {unknown[0]!r}; an expression may use {known}")
        functions = {name for name in references["functions"] if name.isidentifier()}
        missing = sorted(functions - STANDARD_FUNCTIONS - FUNCTIONS.keys())
        if missing:
            known = ", ".join(sorted(STANDARD_FUNCTIONS | FUNCTIONS.keys()))
            raise ValueError(f"unknown function {missing[0]!r}; known: {known}")
        self.variables: frozenset[str] = allowed & named

    def evaluate(self, context: cel.Context) -> Any:
        """Return the value in `context`; raises whatever the expression runs into."""
        return self._program.execute(context)


def make_context(variables: Mapping[str, Any]) -> cel.Context:
    """Convert `variables` once, for any number of expressions."""
    return cel.Context(variables=dict(variables), functions=dict(FUNCTIONS))


def _syntax_problem(error: ValueError) -> str:
    """Return the parser's complaint without the expression that it repeats."""
    found = re.search(r"<input>:(\d+):(\d+): (.*)", str(error))
    if found is None:
        return str(error).splitlines()[0]
    return f"line {found[1]}, column {found[2]}: {found[3].split(' expecting ')[0]}"
