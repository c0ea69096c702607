"""The core: rules that are in force whatever a rule file says.

They are part of the package (`shipped_rules.json`), the same as those of the shipped file. A file
may add to them: a rule of its own under the same id is decided besides the core's.
"""

import hashlib
from dataclasses import replace

from pa_console.policy.expressions.deadlines import DEADLINE_S
from pa_console.policy.rule_seal import (
    SHIPPED,
    ShippedRules,
    canonical,
    content_sha256,
    plain_rule,
)
from pa_console.policy.rulebook import CompiledRule, Compiler, Rulebook
from pa_console.schema.rule import Rule, RuleSet

_DECISIVE = ("priority", "applies", "check", "order")


def core_sha256() -> str:
    """Return the hash of the core, by which a log names it."""
    plain = canonical([plain_rule(rule) for rule in SHIPPED.core])
    return hashlib.sha256(plain.encode()).hexdigest()


def differing_core(rulebook: Rulebook) -> tuple[str, ...]:
    """Return the ids of the core's rules that `rulebook` itself lacks or has otherwise."""
    own = {rule.id: rule for rule in rulebook.rules}
    return tuple(rule.id for rule in SHIPPED.core if not _as_strict(own.get(rule.id), rule))


def with_core(rulebook: Rulebook, deadline_s: float = DEADLINE_S) -> Rulebook:
    """Return the same rules with the core's in force besides; once it is, nothing changes."""
    if rulebook.seal.core:
        return rulebook
    compiler = Compiler(deadline_s)
    known = {entry.rule.id: entry for entry in rulebook.compiled}
    added: list[CompiledRule] = []
    for rule in SHIPPED.core:
        entry = known.get(rule.id)
        if entry is None:
            added.append(compiler.rule(rule))
        elif not _as_strict(entry.rule, rule):
            known[rule.id] = replace(entry, core=compiler.rule(rule))
    return Rulebook(
        rulebook.name,
        rulebook.sha256,
        (*known.values(), *added),
        rulebook.workflows,
        rulebook.seal.model_copy(update={"core": core_sha256()}),
        rule_set=rulebook.rule_set,
    )


def _as_strict(own: Rule | None, core: Rule) -> bool:
    """Return whether a file's own rule decides exactly as the core's does."""
    return own is not None and all(getattr(own, name) == getattr(core, name) for name in _DECISIVE)


CORE_IDS = ("ROE-01", "ROE-02", "ROE-03", "ROE-05", "ROE-09", "WF-03", "CAP-01", "CAP-06")
"""The ids without which no plan is safe: force, escalation, evidence, overriding, cover, reach."""


def shipped_rules(rule_set: RuleSet) -> ShippedRules:
    """Return what the package is to vouch for; raises KeyError without a rule of the core."""
    by_id = {rule.id: rule.model_copy(update={"examples": ()}) for rule in rule_set.rules}
    return ShippedRules(
        name=rule_set.name,
        content_sha256=content_sha256(rule_set),
        core=tuple(by_id[name] for name in CORE_IDS),
    )
