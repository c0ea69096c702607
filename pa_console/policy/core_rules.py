"""The core: rules that are in force whatever a rule file says, and how they are compiled in.

They are compiled into the package (`shipped_rules`), the same as those of the shipped file. A file
may add to them: a rule of its own under the same id is decided besides the core's.
"""

import hashlib
from dataclasses import replace

from pa_console.policy.expressions.deadlines import DEADLINE_S
from pa_console.policy.rule_seal import canonical, content_sha256, plain_rule
from pa_console.policy.rulebook import CompiledRule, Compiler, Rulebook
from pa_console.policy.shipped_rules import CORE
from pa_console.schema.rule import Ordering, Rule, RuleSet

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
    """Return whether a file's own rule decides exactly as the core's does."""
    return own is not None and all(getattr(own, name) == getattr(core, name) for name in _DECISIVE)


CORE_IDS = ("ROE-01", "ROE-02", "ROE-03", "ROE-05", "ROE-09", "WF-03", "CAP-01", "CAP-06")
"""The ids without which no plan is safe: force, escalation, evidence, overriding, cover, reach."""

_HEAD = '''"""The shipped rules: their content's hash, and the core. Made by `rules pin --write`."""

# ruff: noqa: E501
# fmt: off

from pa_console.schema.rule import Ordering, Rule

NAME = {name!r}
CONTENT_SHA256 = "{content}"
"""The content that a set called NAME has when it is as shipped."""

CORE: tuple[Rule, ...] = (
{rules})
"""Rules that no file can weaken, only add to (`core_rules.py`)."""
'''


def shipped_source(rule_set: RuleSet) -> str:
    """Return the module for `rule_set`; raises KeyError when it lacks a rule of the core."""
    by_id = {rule.id: rule for rule in rule_set.rules}
    rules = "".join(_rule(by_id[name]) for name in CORE_IDS)
    return _HEAD.format(name=rule_set.name, content=content_sha256(rule_set), rules=rules)


def _rule(rule: Rule) -> str:
    fields = [
        f"        id={rule.id!r},",
        f"        domain={rule.domain!r},",
        f"        priority={rule.priority!r},",
        f"        text={rule.text!r},",
        f"        tags={rule.tags!r},",
    ]
    if rule.applies is not None:
        fields.append(f"        applies={_text(rule.applies)},")
    if rule.check is not None:
        fields.append(f"        check={_text(rule.check)},")
        fields.append(f"        message={_text(rule.message)},")
    if rule.order:
        orders = "".join(f"            {_order(order)},\n" for order in rule.order)
        fields.append(f"        order=(\n{orders}        ),")
    body = "\n".join(fields)
    return f"    Rule(\n{body}\n    ),\n"


def _order(order: Ordering) -> str:
    given = order.model_dump(exclude_defaults=True)
    return f"Ordering({', '.join(f'{name}={value!r}' for name, value in given.items())})"


def _text(text: str) -> str:
    """Return `text` as Python: over its own lines, where it has more than one."""
    if "\n" in text and "'''" not in text and not text.endswith(("'", "\\")):
        return f"r'''{text}'''"
    return repr(text)
