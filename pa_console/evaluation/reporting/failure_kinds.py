"""In which way a run failed, told from its record alone: for counting what goes wrong most."""

import re
from typing import NamedTuple

from pa_console.evaluation.record import RunRecord

_RULE = re.compile(r"^[A-Z]{2,5}-\d+")
_ROOT = re.compile(r"\brun\.((?:start|final)\.[a-z]+|[a-z_]+)")
_FIELD = re.compile(r"(?:\]|\b(?!run\b)[a-z]\w{0,2})\.([a-z_]+)\b(?!\()")
_NAME = re.compile(r"\b\w*(?:[a-z][A-Z]|_|\d)\w*\b")
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
_CONSTANTS = frozenset(("gates", "base", "command", "grace_s", "standoff_m"))
"""Fields of `run` that tell of the world or the command: they cannot be what failed."""

EXECUTED = frozenset(("verified", "unverified"))
"""Statuses of missions whose plan was carried out, or begun."""


class FailureKind(NamedTuple):
    """What was to be done, how the mission ended, and what went wrong."""

    wanted: str
    ended: str
    cause: str


def failure_kind(record: RunRecord) -> FailureKind | None:
    """Return in which way `record` failed, None when it is a strict success.

    The cause of a run that executed something is the rules it broke and the kinds of condition
    that do not hold; of any other run it is why nothing was executed.
    """
    if record.strict:
        return None
    wanted = {"refuse": "refuse", "trim": "carry out a part"}.get(record.expect, "carry out")
    causes = [f"broke {rule}" for rule in sorted({breach.rule_id for breach in record.broken})]
    if record.status in EXECUTED:
        causes += sorted({f"condition on {condition_kind(text)}" for text in record.failed})
    else:
        causes.append(reason_pattern(record.reason))
    return FailureKind(wanted, record.status, "; ".join(filter(None, causes)) or "no cause is told")


def condition_kind(condition: str) -> str:
    """Return which facts of the run a success condition looks at, without any name or number.

    `run.tracks.exists(t, t.gate == 'X' && t.observed_s >= 0.0)` is `tracks (gate, observed_s)`.
    """
    bare = _QUOTED.sub("''", condition)
    roots = dict.fromkeys(name for name in _ROOT.findall(bare) if name not in _CONSTANTS)
    fields = dict.fromkeys(name for name in _FIELD.findall(bare))
    text = ", ".join(roots) or "nothing of the run"
    return f"{text} ({', '.join(fields)})" if fields else text


def reason_pattern(reason: str) -> str:
    """Return why nothing was executed, as rule ids or words without names and numbers."""
    kinds: dict[str, None] = {}
    for part in filter(None, (piece.strip() for piece in reason.split(";"))):
        rule = _RULE.match(part)
        words = _NAME.sub("…", _QUOTED.sub("…", part))
        kinds[rule.group() if rule else re.sub(r"…(\W+…)+", "…", words)[:60]] = None
    return "; ".join(sorted(kinds))
