"""The rulebook: a rule file with compiled expressions. An unenforceable file is refused as a whole.

The core (`shipped_rules.json`) is in force with every rule file. A file may add to the core: a rule
with the id of a core rule is decided in addition to the core rule.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

from pa_console.policy.expressions.deadlines import DEADLINE_S
from pa_console.policy.expressions.expression import (
    MOMENT_VARIABLES,
    PLAN_VARIABLES,
    SUBJECT_VARIABLES,
    WORKFLOW_VARIABLES,
    Expression,
)
from pa_console.policy.expressions.fields import Fields, united
from pa_console.policy.expressions.forbidden_words import forbidden_patterns
from pa_console.policy.rule_seal import (
    SHIPPED,
    ShippedRules,
    canonical,
    content_sha256,
    plain_rule,
    seal_of,
)
from pa_console.policy.rule_variables import PLAN_SHAPES
from pa_console.schema.command import Verb
from pa_console.schema.document import Document, FieldPath, read_text
from pa_console.schema.rule import Ordering, Rule, RuleSet, RulesSeal, Workflow

MAX_SET_SIZE = 100_000
"""The limit on the tokens of all expressions in a file; each expression counts for EXPRESSION_SIZE
more tokens."""
EXPRESSION_SIZE = 20

MISSION_VARIABLES = frozenset(("mission", "world"))
LIMIT_VARIABLES = frozenset(("world",))

_DECISIVE = ("priority", "applies", "check", "order")
CORE_IDS = ("ROE-01", "ROE-02", "ROE-03", "ROE-05", "ROE-09", "WF-03", "CAP-01", "CAP-06")
"""The rules without which no plan is safe: force, escalation, evidence, overriding, cover, reach.
"""


@dataclass(frozen=True)
class CompiledOrdering:
    """A compiled ordering; `seconds` is set if the world defines the time limit."""

    order: Ordering
    event: Expression
    other: Expression
    seconds: Expression | None

    @property
    def fixed(self) -> bool:
        """True if its expressions depend on the subject alone, not on the rest of the moment."""
        return "now" not in self.event.variables | self.other.variables


@dataclass(frozen=True)
class CompiledRule:
    """A rule with its compiled expressions; guard and check are None if the rule has none."""

    rule: Rule
    applies: Expression | None
    check: Expression | None
    order: tuple[CompiledOrdering, ...] = ()
    core: "CompiledRule | None" = None
    """The core's rule of the same id, which is decided in addition."""

    @property
    def parts(self) -> "tuple[CompiledRule, ...]":
        """The rule itself, and the core's rule of the same id if it differs."""
        return (self,) if self.core is None else (self, self.core)

    @property
    def variables(self) -> frozenset[str]:
        """The variables that the guard and the check read."""
        parts = [part.variables for part in (self.applies, self.check) if part is not None]
        return frozenset[str]().union(*parts)

    @cached_property
    def reads(self) -> Fields:
        """The fields of the variables that the guard and the check read."""
        parts = [part.reads(PLAN_SHAPES) for part in (self.applies, self.check) if part is not None]
        return united(parts)

    @property
    def about_mission_only(self) -> bool:
        """True if the rule can be decided at intake, from the mission's words alone."""
        return self.check is not None and self.variables <= MISSION_VARIABLES


@dataclass(frozen=True)
class CompiledPhase:
    """The guard and the end condition of one phase."""

    when: Expression
    done: Expression


@dataclass(frozen=True)
class CompiledWorkflow:
    """A compiled workflow; `ends` and `phases` are in the order of the file."""

    workflow: Workflow
    starts: Expression
    ends: tuple[tuple[str, Expression], ...]
    phases: tuple[CompiledPhase, ...]


class ExpressionError(ValueError):
    """An expression that does not compile; `field` is its place within the rule or workflow."""

    def __init__(self, field: FieldPath, problem: str) -> None:
        super().__init__(f"{'.'.join(map(str, field))}: {problem}")
        self.field, self.problem = field, problem


class Compiler:
    """A compiler of expressions; each may run for `deadline_s`, and their total size is limited."""

    def __init__(self, deadline_s: float = DEADLINE_S) -> None:
        self._deadline_s = deadline_s
        self._left = MAX_SET_SIZE

    def rule(self, rule: Rule) -> CompiledRule:
        """Return `rule` compiled; raises ExpressionError."""
        plan = PLAN_VARIABLES
        return CompiledRule(
            rule,
            None if rule.applies is None else self._compile(("applies",), rule.applies, plan),
            None if rule.check is None else self._compile(("check",), rule.check, plan),
            tuple(self._ordering(number, order) for number, order in enumerate(rule.order)),
        )

    def workflow(self, workflow: Workflow) -> CompiledWorkflow:
        """Return `workflow` compiled; raises ExpressionError."""
        return CompiledWorkflow(
            workflow,
            self._compile(("starts",), workflow.starts, WORKFLOW_VARIABLES),
            tuple(
                (outcome, self._compile(("ends", outcome), source, WORKFLOW_VARIABLES))
                for outcome, source in workflow.ends.items()
            ),
            tuple(
                CompiledPhase(
                    self._compile(("phases", number, "when"), phase.when, WORKFLOW_VARIABLES),
                    self._compile(("phases", number, "done"), phase.done, WORKFLOW_VARIABLES),
                )
                for number, phase in enumerate(workflow.phases)
            ),
        )

    def _ordering(self, number: int, order: Ordering) -> CompiledOrdering:
        place = ("order", number)
        allowed = SUBJECT_VARIABLES if order.each is not None else MOMENT_VARIABLES
        return CompiledOrdering(
            order,
            self._compile((*place, "event"), order.event, allowed),
            self._compile((*place, "other"), order.other, allowed),
            self._compile((*place, "seconds"), order.seconds, LIMIT_VARIABLES)
            if isinstance(order.seconds, str)
            else None,
        )

    def _compile(self, field: FieldPath, source: str, allowed: frozenset[str]) -> Expression:
        try:
            expression = Expression(source, allowed, self._deadline_s)
        except ValueError as error:
            raise ExpressionError(field, str(error)) from error
        self._left -= expression.size + EXPRESSION_SIZE
        if self._left < 0:
            raise ExpressionError(field, "the expressions up to here are too many for one file")
        return expression


def compile_rule(rule: Rule) -> CompiledRule:
    """Return `rule` compiled; raises ExpressionError."""
    return Compiler().rule(rule)


class Rulebook:
    """All rules in force and their workflows; `sha256` is the hash of the file."""

    def __init__(
        self,
        name: str,
        sha256: str,
        compiled: tuple[CompiledRule, ...],
        workflows: tuple[CompiledWorkflow, ...] = (),
        seal: RulesSeal | None = None,
        *,
        rule_set: RuleSet | None = None,
    ) -> None:
        """Set `seal` and `rule_set` from the rule file; both are None for rules without a file."""
        self.name, self.sha256, self.compiled = name, sha256, compiled
        self.workflows, self.seal = workflows, seal or RulesSeal()
        self.rule_set = rule_set
        self.rules: tuple[Rule, ...] = tuple(entry.rule for entry in compiled)
        self.parts = tuple(part for entry in compiled for part in entry.parts)
        """Every rule that is decided, including those of the core."""
        self._by_id = {rule.id: rule for rule in self.rules}

    @cached_property
    def reads(self) -> Fields:
        """The fields that guards and checks read; no other fields have to be converted for CEL."""
        return united(part.reads for part in self.parts)

    def prepare(self) -> None:
        """Compile the patterns that the first mission's checks need, which takes 100 ms."""
        forbidden_patterns()
        for part in self.parts:
            for expression in (part.applies, part.check):
                if expression is not None:
                    expression.prepare()

    @property
    def approvals(self) -> Mapping[str, int]:
        """The number of people who must approve each act; one for acts that are not listed."""
        return self.rule_set.approvals if self.rule_set is not None else {}

    @property
    def unasked(self) -> tuple[Verb, ...]:
        """The commands that a standing order may carry out without a separate approval."""
        return self.rule_set.standing.allowed if self.rule_set is not None else ()

    def get(self, rule_id: str) -> Rule:
        """Return the rule `rule_id`; raises KeyError if it is not in force."""
        return self._by_id[rule_id]

    def orderings(self, rule_id: str) -> tuple[Ordering, ...]:
        """Return a rule's orderings, with the core's; raises KeyError if it is not in force."""
        self.get(rule_id)
        parts = next(entry.parts for entry in self.compiled if entry.rule.id == rule_id)
        return tuple(order for part in parts for order in part.rule.order)

    def sealed(self, seal: RulesSeal) -> "Rulebook":
        """Return the same rules with another seal."""
        return Rulebook(
            self.name, self.sha256, self.compiled, self.workflows, seal, rule_set=self.rule_set
        )


def load_rules(path: Path, deadline_s: float = DEADLINE_S) -> Rulebook:
    """Read the rules at `path`; raises DocumentError with file, line and field.

    Unknown fields, a repeated id, a check without a message, and CEL that does not compile or uses
    an unknown name are all errors: a rule is in force as written or not at all. The rulebook's seal
    records whether the set was altered after it was signed; the caller decides whether to refuse
    it. Each expression may run for `deadline_s` of processor time. Raises SigningError if this
    machine's keys cannot be read.
    """
    sha256, rule_set, rules, workflows = _compiled(str(path), read_text(path), deadline_s)
    seal = seal_of(path, rule_set)
    return Rulebook(rule_set.name, sha256, rules, workflows, seal, rule_set=rule_set)


# Cached by content: reading an unchanged set again, by a second station or after an edit was
# undone, costs a look-up. The signature is not part of the content and is read each time.
@lru_cache(maxsize=4)
def _compiled(
    source: str, text: str, deadline_s: float
) -> tuple[str, RuleSet, tuple[CompiledRule, ...], tuple[CompiledWorkflow, ...]]:
    """Return the content's SHA-256, and the compiled rule set; raises DocumentError."""
    document = Document(source, text)
    rule_set = parse_rule_set(document)
    return (document.sha256, rule_set, *compile_rule_set(document, rule_set, deadline_s))


def read_rule_set(path: Path) -> tuple[Document, RuleSet]:
    """Read the rules at `path` without compiling them; raises DocumentError."""
    document = Document.read(path)
    return document, parse_rule_set(document)


def parse_rule_set(document: Document) -> RuleSet:
    """Parse `document` as a rule set, without compiling it; raises DocumentError."""
    rule_set = document.parse(RuleSet)
    _refuse_repeated(document, "rules", (rule.id for rule in rule_set.rules))
    _refuse_repeated(document, "workflows", (entry.id for entry in rule_set.workflows))
    return rule_set


def compile_rule_set(
    document: Document, rule_set: RuleSet, deadline_s: float = DEADLINE_S
) -> tuple[tuple[CompiledRule, ...], tuple[CompiledWorkflow, ...]]:
    """Compile the rules and workflows of `document`; raises DocumentError."""
    compiler = Compiler(deadline_s)
    place: FieldPath = ()
    rules: list[CompiledRule] = []
    workflows: list[CompiledWorkflow] = []
    try:
        for index, rule in enumerate(rule_set.rules):
            place = ("rules", index)
            rules.append(compiler.rule(rule))
        for index, workflow in enumerate(rule_set.workflows):
            place = ("workflows", index)
            workflows.append(compiler.workflow(workflow))
    except ExpressionError as error:
        raise document.error((*place, *error.field), error.problem) from error
    return tuple(rules), tuple(workflows)


def _refuse_repeated(document: Document, part: str, ids: Iterable[str]) -> None:
    seen: set[str] = set()
    for index, name in enumerate(ids):
        if name in seen:
            raise document.error((part, index, "id"), f"{name!r} appears twice")
        seen.add(name)


def core_sha256() -> str:
    """Return the hash of the core, which identifies it in a log."""
    plain = canonical([plain_rule(rule) for rule in SHIPPED.core])
    return hashlib.sha256(plain.encode()).hexdigest()


def differing_core(rulebook: Rulebook) -> tuple[str, ...]:
    """Return the ids of core rules that `rulebook` itself lacks or decides differently."""
    own = {rule.id: rule for rule in rulebook.rules}
    return tuple(rule.id for rule in SHIPPED.core if not _as_strict(own.get(rule.id), rule))


def with_core(rulebook: Rulebook, deadline_s: float = DEADLINE_S) -> Rulebook:
    """Return the same rules with the core in force too; the same rulebook if it already is."""
    if rulebook.seal.core:
        return rulebook
    compiler = Compiler(deadline_s)
    by_id = {entry.rule.id: entry for entry in rulebook.compiled}
    added: list[CompiledRule] = []
    for rule in SHIPPED.core:
        entry = by_id.get(rule.id)
        if entry is None:
            added.append(compiler.rule(rule))
        elif not _as_strict(entry.rule, rule):
            by_id[rule.id] = replace(entry, core=compiler.rule(rule))
    return Rulebook(
        rulebook.name,
        rulebook.sha256,
        (*by_id.values(), *added),
        rulebook.workflows,
        rulebook.seal.model_copy(update={"core": core_sha256()}),
        rule_set=rulebook.rule_set,
    )


def _as_strict(own: Rule | None, core: Rule) -> bool:
    """Return whether a file's own rule decides exactly as the core's rule."""
    return own is not None and all(getattr(own, name) == getattr(core, name) for name in _DECISIVE)


def shipped_rules(rule_set: RuleSet) -> ShippedRules:
    """Return the rules to ship with the package; raises KeyError if a core rule is missing."""
    by_id = {rule.id: rule.model_copy(update={"examples": ()}) for rule in rule_set.rules}
    return ShippedRules(
        name=rule_set.name,
        content_sha256=content_sha256(rule_set),
        core=tuple(by_id[name] for name in CORE_IDS),
    )
