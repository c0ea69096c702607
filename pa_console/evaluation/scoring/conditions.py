"""Success conditions of missions: CEL over `run`, compiled once and evaluated on a run's facts."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cel

from pa_console.evaluation.scoring.condition_names import wrong_name
from pa_console.evaluation.scoring.run_facts import RunFacts
from pa_console.schema.world import World

_FUNCTIONS = frozenset(
    ("contains", "double", "endsWith", "has", "int", "matches", "size", "startsWith", "string")
)
_BOUND = re.compile(r"\.\s*(?:all|exists|exists_one|filter|map)\s*\(\s*(\w+)\s*,")


@dataclass(frozen=True)
class Conditions:
    """Compiled success conditions, in the order of their sources."""

    sources: tuple[str, ...]
    programs: tuple[cel.Program, ...]


def compile_conditions(sources: Sequence[str], world: World | None = None) -> Conditions:
    """Compile `sources`; raises ValueError for what is not CEL or asks for what no run has.

    With `world`, gates and assets named as keys must exist in it.
    """
    return Conditions(tuple(sources), tuple(compile_condition(text, world) for text in sources))


def compile_condition(source: str, world: World | None = None) -> cel.Program:
    """Compile one condition; raises ValueError as `compile_conditions` does."""
    try:
        program = cel.compile(source)
    except ValueError as error:
        raise ValueError(f"not valid CEL: {_syntax_problem(error)}") from error
    references = program.references()
    unknown = sorted(set(references["variables"]) - set(_BOUND.findall(source)) - {"run"})
    if unknown:
        raise ValueError(f"unknown name {unknown[0]!r}; a condition may only speak of 'run'")
    functions = {name for name in references["functions"] if name.isidentifier()}
    if missing := sorted(functions - _FUNCTIONS):
        raise ValueError(f"unknown function {missing[0]!r}; known: {', '.join(sorted(_FUNCTIONS))}")
    if problem := wrong_name(source, world):
        raise ValueError(problem)
    return program


def evaluate(conditions: Conditions, facts: RunFacts) -> tuple[str, ...]:
    """Return the sources that do not hold; one that cannot be evaluated is told with its error."""
    context = cel.Context(variables={"run": facts.document()})
    failed: list[str] = []
    for source, program in zip(conditions.sources, conditions.programs, strict=True):
        try:
            value: Any = program.execute(context)
        except Exception as error:  # the CEL runtime raises many kinds; all mean "does not hold"
            failed.append(f"{source} (error: {type(error).__name__}: {error})")
            continue
        if not isinstance(value, bool):
            failed.append(f"{source} (error: it yields {value!r}, not true or false)")
        elif not value:
            failed.append(source)
    return tuple(failed)


def _syntax_problem(error: ValueError) -> str:
    """Return where the parser stumbled, without the expression that it repeats."""
    found = re.search(r"<input>:(\d+):(\d+): (.*)", str(error))
    if found is None:
        return str(error).splitlines()[0]
    return f"line {found[1]}, column {found[2]}: {found[3].split(' expecting ')[0]}"
