"""The differences between two rule sets: rule by rule, field by field, word by word."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Literal, cast

from pa_console.policy.rule_seal import Plain, canonical, plain_head, plain_rule, plain_workflow
from pa_console.schema.rule import RuleSet

Part = Literal["set", "rule", "workflow"]
Kind = Literal["added", "removed", "changed", "moved"]
Word = tuple[Literal["same", "removed", "added"], str]

_WORD = re.compile(r"\s+|\w+|[^\w\s]")


@dataclass(frozen=True)
class FieldChange:
    """One field that differs; None means that the field is missing or has its default."""

    field: str
    before: object
    after: object


@dataclass(frozen=True)
class Change:
    """A change to one rule, one workflow or the set's own head, whose `id` is empty.

    The kind `moved` is an unchanged entry that has another place among the entries of both sets.
    For an added or removed rule, `fields` has all its fields.
    """

    part: Part
    id: str
    kind: Kind
    fields: tuple[FieldChange, ...]


def compare_rules(before: RuleSet, after: RuleSet) -> tuple[Change, ...]:
    """Return every difference, in the order of the files; empty exactly if the hashes are equal."""
    head = tuple(_fields(plain_head(before), plain_head(after)))
    return (
        *((Change("set", "", "changed", head),) if head else ()),
        *_compare(
            "rule",
            {rule.id: plain_rule(rule) for rule in before.rules},
            {rule.id: plain_rule(rule) for rule in after.rules},
        ),
        *_compare(
            "workflow",
            {workflow.id: plain_workflow(workflow) for workflow in before.workflows},
            {workflow.id: plain_workflow(workflow) for workflow in after.workflows},
        ),
    )


def word_changes(before: str, after: str) -> list[Word]:
    """Return the stretches of words that were kept, removed or added between the two texts."""
    old, new = _WORD.findall(before), _WORD.findall(after)
    stretches: list[Word] = []
    for kind, a, b, c, d in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        if kind == "equal":
            stretches.append(("same", "".join(old[a:b])))
            continue
        if b > a:
            stretches.append(("removed", "".join(old[a:b])))
        if d > c:
            stretches.append(("added", "".join(new[c:d])))
    return stretches


def _compare(part: Part, before: Mapping[str, Plain], after: Mapping[str, Plain]) -> list[Change]:
    old = [key for key in before if key in after]
    new = [key for key in after if key in before]
    blocks = SequenceMatcher(None, old, new, autojunk=False).get_matching_blocks()
    kept = {key for block in blocks for key in old[block.a : block.a + block.size]}
    changes: list[Change] = []
    for key in (*before, *(key for key in after if key not in before)):
        fields = list(_fields(before.get(key, {}), after.get(key, {})))
        if key not in after:
            changes.append(Change(part, key, "removed", tuple(fields)))
        elif key not in before:
            changes.append(Change(part, key, "added", tuple(fields)))
        else:
            kind: Kind = "changed" if fields else "moved"
            if key not in kept:
                fields.append(FieldChange("place", old.index(key) + 1, new.index(key) + 1))
            if fields:
                changes.append(Change(part, key, kind, tuple(fields)))
    return changes


def _fields(before: Plain, after: Plain) -> Iterator[FieldChange]:
    """Yield the differing fields; a field whose entries are only reordered is yielded whole."""
    for name in (*before, *(name for name in after if name not in before)):
        a, b = before.get(name), after.get(name)
        if canonical(a) == canonical(b):
            continue
        old, new = dict(_leaves(name, a)), dict(_leaves(name, b))
        places = (*old, *(place for place in new if place not in old))
        changes = [
            FieldChange(place, old.get(place), new.get(place))
            for place in places
            if place not in old
            or place not in new
            or canonical(old[place]) != canonical(new[place])
        ]
        yield from changes or (FieldChange(name, a, b),)


def _leaves(place: str, value: object) -> Iterator[tuple[str, object]]:
    """Yield the values below `place`; list entries are identified by name if all have one."""
    if isinstance(value, dict) and value:
        for key, below in cast(dict[str, object], value).items():
            yield from _leaves(f"{place}.{key}", below)
        return
    entries = cast(tuple[object, ...], value) if isinstance(value, list | tuple) else ()
    mappings = [cast(Plain, entry) for entry in entries if isinstance(entry, dict)]
    if not entries or len(mappings) < len(entries):
        yield place, value
        return
    names = [str(entry.get("name", "")) for entry in mappings]
    named = all(names) and len(set(names)) == len(names)
    for number, entry in enumerate(mappings):
        yield from _leaves(f"{place}.{names[number] if named else number}", entry)
