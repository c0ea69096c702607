"""What a rule set says, free of how its file is written: its plain values and their hash."""

import hashlib
import json

from pa_console.schema.rule import Rule, RuleSet, Workflow

Plain = dict[str, object]


def content_sha256(rule_set: RuleSet) -> str:
    """Return the SHA-256 of everything that `rule_set` says, 64 hexadecimal digits.

    Covered are name, version, source, every field of every rule and workflow, and the order of
    rules, workflows and the lists in them. Not covered are comments, white space, quoting, the
    order of keys, and whether a default is written down.
    """
    return hashlib.sha256(canonical(plain_set(rule_set)).encode()).hexdigest()


def plain_set(rule_set: RuleSet) -> Plain:
    """Return everything of `rule_set` that is not a default, as JSON knows it."""
    return {
        **plain_head(rule_set),
        "rules": [plain_rule(rule) for rule in rule_set.rules],
        "workflows": [plain_workflow(workflow) for workflow in rule_set.workflows],
    }


def plain_head(rule_set: RuleSet) -> Plain:
    """Return what `rule_set` says of itself, without its rules and workflows."""
    return rule_set.model_dump(exclude={"rules", "workflows"}, exclude_defaults=True)


def plain_rule(rule: Rule) -> Plain:
    """Return every field of `rule` that is not a default."""
    return rule.model_dump(exclude_defaults=True)


def plain_workflow(workflow: Workflow) -> Plain:
    """Return every field of `workflow` that is not a default; its ends are pairs, in order.

    The first end that holds counts, so that their order is part of what they say.
    """
    plain = workflow.model_dump(exclude_defaults=True)
    if workflow.ends:
        plain["ends"] = list(workflow.ends.items())
    return plain


def canonical(value: object) -> str:
    """Return `value` as JSON that is the same for the same value: keys sorted, ASCII, compact."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))
