"""Loads a rule file and compiles its checks; a file that cannot be enforced is refused whole."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

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


class ExpressionError(ValueError):
    """A guard or check that does not compile; `field` says which of the two."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")
        self.field, self.problem = field, problem


def compile_rule(rule: Rule) -> CompiledRule:
    """Return `rule` ready to run; raises ExpressionError."""
    return CompiledRule(rule, _compile("applies", rule.applies), _compile("check", rule.check))


class Rulebook:
    """Every rule in force; `sha256` is that of the file."""

    def __init__(self, name: str, sha256: str, compiled: tuple[CompiledRule, ...]) -> None:
        self.name, self.sha256, self.compiled = name, sha256, compiled
        self.rules: tuple[Rule, ...] = tuple(entry.rule for entry in compiled)
        self._by_id = {rule.id: rule for rule in self.rules}
        self.variables = frozenset[Variable]().union(*(entry.variables for entry in compiled))
        """What any check reads; nothing else has to be converted for CEL."""

    def get(self, rule_id: str) -> Rule:
        """Return the rule `rule_id`; raises KeyError when it is not in force."""
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
        try:
            compiled.append(compile_rule(rule))
        except ExpressionError as error:
            raise document.error(("rules", index, error.field), error.problem) from error
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return Rulebook(rule_set.name, sha256, tuple(compiled))


def _compile(field: str, source: str | None) -> Expression | None:
    if source is None:
        return None
    try:
        return Expression(source)
    except ValueError as error:
        raise ExpressionError(field, str(error)) from error
