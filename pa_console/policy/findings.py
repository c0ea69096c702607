"""Findings in words: what a rule's check or ordering comes to, with the offenders named."""

from collections.abc import Iterable

from pa_console.schema.finding import Finding, FindingStatus
from pa_console.schema.rule import Rule

MAX_OFFENDERS = 6
MAX_ERROR = 200


def finding(rule: Rule, status: FindingStatus, message: str = "") -> Finding:
    """Return the finding of `rule`."""
    return Finding(rule_id=rule.id, priority=rule.priority, status=status, message=message)


def undecided(rule: Rule, problem: str) -> Finding:
    """Return the finding of a rule that could not be decided, which counts as broken."""
    words = " ".join(problem.split())[:MAX_ERROR]
    return finding(rule, "error", f"the check could not decide: {words}")


def violation(message: str, offenders: Iterable[str]) -> str:
    """Return `message` with the distinct offenders after it, at most MAX_OFFENDERS of them."""
    distinct = [name for name in dict.fromkeys(offenders) if name]
    if not distinct:
        return message
    more = len(distinct) - MAX_OFFENDERS
    listed = ", ".join(distinct[:MAX_OFFENDERS]) + (f" and {more} more" if more > 0 else "")
    return f"{message}: {listed}"
