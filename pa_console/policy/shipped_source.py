"""Writes `shipped_rules.py`: the hash of the shipped rule set and its core, as Python."""

from pa_console.policy.content import content_sha256
from pa_console.schema.rule import Ordering, Rule, RuleSet

CORE_IDS = ("ROE-01", "ROE-02", "ROE-03", "ROE-05", "ROE-09", "WF-03", "CAP-01", "CAP-06")
"""Without these nothing is safe: force, escalation, evidence, overriding, cover, reach."""

_HEAD = '''"""The shipped rules: their content's hash, and the core. Made by `rules pin --write`."""

# ruff: noqa: E501
# fmt: off

from pa_console.schema.rule import Ordering, Rule

NAME = {name!r}
CONTENT_SHA256 = "{content}"
"""The content that a set called NAME has when it is as shipped."""

CORE: tuple[Rule, ...] = (
{rules})
"""Rules that no file can weaken, only add to (`core.py`)."""
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
