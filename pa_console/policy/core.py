"""The core: rules that are in force whatever a rule file says of them or leaves out.

They are compiled into the package (`shipped_rules`), the same as those of the shipped file. A file
may add to them: a rule of its own under the same id is decided besides the core's.
"""

import hashlib
from dataclasses import replace

from pa_console.policy.allowance import DEADLINE_S
from pa_console.policy.content import canonical, plain_rule
from pa_console.policy.rulebook import CompiledRule, Compiler, Rulebook
from pa_console.policy.shipped_rules import CORE
from pa_console.schema.rule import Rule

_DECISIVE = ("priority", "applies", "check", "order")


def core_sha256() -> str:
    """Return the hash of the core, by which a log names it."""
    plain = canonical([plain_rule(rule) for rule in CORE])
    return hashlib.sha256(plain.encode()).hexdigest()


def differing_core(rulebook: Rulebook) -> tuple[str, ...]:
    """Return the ids of the core's rules that `rulebook` itself lacks or has otherwise."""
    own = {rule.id: rule for rule in rulebook.rules}
    return tuple(rule.id for rule in CORE if not _as_strict(own.get(rule.id), rule))


def with_core(rulebook: Rulebook, deadline_s: float = DEADLINE_S) -> Rulebook:
    """Return the same rules with the core's in force besides; once it is, nothing changes."""
    if rulebook.seal.core:
        return rulebook
    compiler = Compiler(deadline_s)
    known = {entry.rule.id: entry for entry in rulebook.compiled}
    added: list[CompiledRule] = []
    for rule in CORE:
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
    """Whether a file's own rule decides exactly what the core's does."""
    return own is not None and all(getattr(own, name) == getattr(core, name) for name in _DECISIVE)
