"""Success conditions of missions: CEL over `run`, compiled once, its names checked."""

import re
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from types import UnionType
from typing import Any, Literal, get_args, get_origin

import cel
from pydantic import BaseModel

from pa_console.evaluation.scoring.run_facts import RunFacts
from pa_console.evaluation.scoring.run_recording import STAYING, RunRecording
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.world import World

_TEXT = re.compile(r"'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"")
_FIELD = re.compile(r"\.\s*([A-Za-z_]\w*)(?!\w)\s*(\()?")
_KEY = re.compile(r"(?<=[\w)\]])(?<!\bin)\[\s*(?:'([^'\\]*)'|\"([^\"\\]*)\")\s*\]")
_SAID = re.compile(
    r"\.\s*(gate|kind|verb|task|status|identity|intent)\s*[!=]=\s*(?:'([^'\\]*)'|\"([^\"\\]*)\")"
)
_IN = re.compile(
    r"(?:'([^'\\]*)'|\"([^\"\\]*)\")\s+in\s+run\s*\.\s*(moved|reports|gates|coverage|visited)\b(?!\s*\[)"
)


def wrong_name(source: str, world: World | None) -> str:
    """Return what `source` names that no run has, with what there is; '' when all is well.

    Fields of `run` and of what is in it are looked up by name; keys in brackets, and what a gate, a
    kind, a verb and the like are compared with, by value. Agents and frames of actions may be any:
    a run can have orders to what does not exist. Without `world`, only fields of `run` itself are.
    """
    bare = _TEXT.sub("''", source)
    for match in re.finditer(r"\brun\s*\.\s*([A-Za-z_]\w*)", bare):
        if match[1] not in RunFacts.model_fields:
            return f"run has no field {match[1]!r}; known: {', '.join(RunFacts.model_fields)}"
    if world is None:
        return ""
    names = _FIELDS | set(world.gates) | set(world.assets)
    for field, call in _FIELD.findall(bare):
        if not call and field not in names:
            return f"nothing in a run has a field {field!r}; known: {', '.join(sorted(_FIELDS))}"
    for said, known in _values(source, world):
        if said not in known:
            return f"there is no {said!r} here; known: {', '.join(sorted(known))}"
    return ""


def _values(source: str, world: World) -> Iterator[tuple[str, Set[str]]]:
    """Yield every text that must be one of a known set, and that set."""
    gates, assets = set(world.gates), set(world.assets)
    for one, other in _KEY.findall(source):
        yield one or other, gates | assets
    for one, other, where in _IN.findall(source):
        yield one or other, gates if where in {"gates", "coverage"} else assets
    for field, one, other in _SAID.findall(source):
        yield one or other, _WORDS.get(field, gates)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a field's type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from _models(field.annotation)
    for part in get_args(annotation):
        yield from _models(part)


def _words(annotation: Any) -> set[str]:
    """Return the texts that a field may be, none when it may be any."""
    if get_origin(annotation) is Literal:
        return set(get_args(annotation))
    if isinstance(annotation, UnionType):
        return {word for part in get_args(annotation) for word in _words(part)}
    return set()


def _vocabulary() -> dict[str, set[str]]:
    """Return the words that a field of that name may hold anywhere in a run."""
    words: dict[str, set[str]] = {"kind": {"vehicle", "person"}}
    for model in _models(RunFacts):
        for name, field in model.model_fields.items():
            if found := _words(field.annotation):
                words.setdefault(name, set()).update(found)
    return words


_WORDS = _vocabulary()
_FIELDS = frozenset(name for model in _models(RunFacts) for name in model.model_fields)


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


_RUN = re.compile(r"\brun\b(?:\s*\.\s*([A-Za-z_]\w*))?")


def asked_fields(source: str) -> frozenset[str]:
    """Return the fields of `run` that a condition asks for; '' stands for `run` as a whole."""
    return frozenset(match[1] or "" for match in _RUN.finditer(_TEXT.sub("''", source)))


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


FROM_ORDERS = frozenset(
    (
        "command", "status", "refused", "actions", "reports", "moved", "broken", "start",
        "grace_s", "standoff_m", "gates", "base",
    )
)  # fmt: skip
"""Success conditions that depend on the command, the orders and their answers alone, if no order
has sent an asset anywhere."""


def is_decided(case: MissionCase, recording: RunRecording) -> bool:
    """Return whether the score of a finished run of `case` can no longer change.

    It cannot if all orders were to hold or to report and were answered, and the conditions depend
    on orders alone. No order can then move an asset, and only orders break a rule (see oracle.py).
    """
    answered = all(o.verb in STAYING and (o.done or o.rejected) for o in recording.orders)
    return answered and all(asked_fields(source) <= FROM_ORDERS for source in case.success)
