"""Loads a rule file and compiles its checks; a file that cannot be enforced is refused whole."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from pa_console.policy.expression import Expression, Variable
from pa_console.schema.document import Document
from pa_console.schema.rule import Rule, RuleSet

MISSION_VARIABLES: frozenset[Variable] = frozenset(("mission", "world"))


@dataclass(frozen=True)
class CompiledRule:
    """A rule with its guard and check ready to run; both are None where there is none."""

    rule: Rule
    applies: Expression | None
    check: Expression | None

    @property
    def variables(self) -> frozenset[Variable]:
        """What guard and check read."""
        parts = (part.variables for part in (self.applies, self.check) if part is not None)
        return frozenset[Variable]().union(*parts)

    @property
    def about_mission_only(self) -> bool:
        """Whether it can be decided at intake, from the mission's words alone."""
        return self.check is not None and self.variables <= MISSION_VARIABLES


class Rulebook:
    """Every rule in force; `sha256` is that of the file."""

    def __init__(self, name: str, sha256: str, compiled: tuple[CompiledRule, ...]) -> None:
        self.name, self.sha256, self.compiled = name, sha256, compiled
        self.rules: tuple[Rule, ...] = tuple(entry.rule for entry in compiled)
        self._by_id: Mapping[str, CompiledRule] = MappingProxyType(
            {entry.rule.id: entry for entry in compiled}
        )
        self.variables = frozenset[Variable]().union(*(entry.variables for entry in compiled))
        """What any check reads; nothing else has to be converted for CEL."""

    def get(self, rule_id: str) -> Rule:
        """Return the rule `rule_id`; raises KeyError when it is not in force."""
        return self._by_id[rule_id].rule

    def compiled_rule(self, rule_id: str) -> CompiledRule:
        """Return the rule `rule_id` with its programs; raises KeyError like `get`."""
        return self._by_id[rule_id]


def load_rules(path: Path) -> Rulebook:
    """Read the rules at `path`; raises DocumentError with file, line and field.

    Unknown fields, an id that appears twice, a check without a message, and CEL that does not
    compile or uses an unknown name are all errors: a rule is in force as written or not at all.
    """
    document = Document.read(path)
    rule_set = document.parse(RuleSet)
    compiled: list[CompiledRule] = []
    seen: set[str] = set()
    for index, rule in enumerate(rule_set.rules):
        if rule.id in seen:
            raise document.error(("rules", index, "id"), f"{rule.id!r} appears twice")
        seen.add(rule.id)
        applies = _compile(document, index, "applies", rule.applies)
        check = _compile(document, index, "check", rule.check)
        compiled.append(CompiledRule(rule, applies, check))
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return Rulebook(rule_set.name, sha256, tuple(compiled))


def _compile(document: Document, index: int, field: str, source: str | None) -> Expression | None:
    if source is None:
        return None
    try:
        return Expression(source)
    except ValueError as error:
        raise document.error(("rules", index, field), str(error)) from error
