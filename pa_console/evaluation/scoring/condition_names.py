"""Names in success conditions that no run can have: misspelt fields, gates and assets."""

import re
from collections.abc import Iterator, Set
from types import UnionType
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

from pa_console.evaluation.scoring.run_facts import RunFacts
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
