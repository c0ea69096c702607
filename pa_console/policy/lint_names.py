"""Compares the assets, gates and kinds that a rule's text names with those of its expressions."""

import re
from collections.abc import Iterable, Iterator
from re import Pattern

from pa_console.schema.rule import Rule
from pa_console.schema.world import World

_PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_LOOKED_UP = re.compile(r"\b(gates|assets)\s*\[\s*['\"](\w+)['\"]\s*\]")

_GENERAL = re.compile(r"(?i)\bassets?\b")
"""A text that has it speaks of kinds that it does not name."""

Doubt = tuple[str, str, str, str]
"""Field, kind, problem, remedy."""


class NameLint:
    """Knows how a world's names are written: `NorthGate` is also "the north gate"."""

    def __init__(self, world: World) -> None:
        self._world = world.name
        self._known = {"gates": tuple(world.gates), "assets": tuple(world.assets)}
        self._named = {name: _spelling(name) for names in self._known.values() for name in names}
        self._kinds = tuple(world.platforms)

    def named(self, rules: Iterable[Rule]) -> frozenset[str]:
        """Return the assets and gates that texts or expressions of `rules` name."""
        whole = "\n".join(f"{rule.text}\n{_expressions(rule)}" for rule in rules)
        return frozenset(name for name, spelling in self._named.items() if spelling.search(whole))

    def doubts(self, rule: Rule) -> Iterator[Doubt]:
        """Yield where text and expressions disagree, and names that the world does not have."""
        code = _expressions(rule)
        if not code:
            return
        field = "check" if rule.check is not None else "order"
        for kind, name in sorted(set(_LOOKED_UP.findall(code))):
            if name not in self._known[kind]:
                known = ", ".join(self._known[kind])
                problem = f"it looks up {name!r} among the {kind} of {self._world!r}: not there"
                yield field, "unknown name", problem, f"name one of {known}, or go through all"
        said = {name for name, spelling in self._named.items() if spelling.search(rule.text)}
        coded = {name for name in self._named if re.search(rf"\b{re.escape(name)}\b", code)}
        if said != coded:
            problem = f"the text names {_list(said)}, the check {_list(coded)}"
            yield field, "text and check disagree", problem, "name the same in both"
        kinds = {kind for kind in self._kinds if re.search(rf"(?i)\b{kind}s?\b", rule.text)}
        coded_kinds = {kind for kind in self._kinds if re.search(rf"['\"]{kind}['\"]", code)}
        if kinds and coded_kinds and not kinds & coded_kinds and not _GENERAL.search(rule.text):
            problem = f"the text is about {_list(kinds)}, the check about {_list(coded_kinds)}"
            yield field, "text and check disagree", problem, "speak of the same kind in both"


def _spelling(name: str) -> Pattern[str]:
    """Return what finds `name` in a sentence; one of a single word must have its capitals."""
    parts = _PART.findall(name)
    joined = r"[\s_-]*".join(map(re.escape, parts)) if parts else re.escape(name)
    return re.compile(rf"\b{joined}\b", re.IGNORECASE if len(parts) > 1 else re.NOFLAG)


def _expressions(rule: Rule) -> str:
    """Return all CEL of `rule`."""
    parts = [rule.applies, rule.check]
    for order in rule.order:
        parts += [order.event, order.other]
    return "\n".join(part for part in parts if part)


def _list(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"
