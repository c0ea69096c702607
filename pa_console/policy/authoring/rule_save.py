"""Opens one rule of a file and saves it: whole or not at all, and over nobody's work."""

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pa_console.policy.authoring.differences import compare_rules
from pa_console.policy.authoring.rule_file_text import RuleText
from pa_console.policy.rulebook import compile_rule_set, parse_rule_set
from pa_console.schema.document import Document, DocumentError, read_bytes


class RulesChangedError(ValueError):
    """The file has changed since the rule was opened; `same_rule` is False if the rule has, too."""

    def __init__(self, path: Path, *, same_rule: bool) -> None:
        what = "and so was this rule" if same_rule else "but not this rule"
        super().__init__(f"{path}: the file was changed meanwhile, {what}")
        self.same_rule = same_rule


@dataclass(frozen=True)
class OpenRule:
    """A rule taken out of the file `path`; `id` is empty for one that is not in it yet.

    `sha256` is that of the file when the rule was opened, `text` the rule's own, `line` where it
    begins there, `taken` the ids of the other rules.
    """

    path: Path
    sha256: str
    id: str
    text: str
    line: int
    taken: tuple[str, ...]


def open_rule(path: Path, rule_id: str) -> OpenRule:
    """Take a rule out of the file; DocumentError when the file or the rule cannot be read."""
    content, cut = _read(path)
    _known(cut, rule_id)
    text = cut.rule(rule_id)
    with suppress(DocumentError):
        if Document(str(path), text).value is not None:
            return OpenRule(
                path, _sha256(content), rule_id, text, cut.line(rule_id), _others(cut, rule_id)
            )
    problem = f"{rule_id} cannot stand alone (an anchor of another rule?): edit the file itself"
    raise DocumentError(str(path), cut.line(rule_id), rule_id, problem)


def new_rule(path: Path, domain: str) -> OpenRule:
    """Return an empty form for a rule with the next free id of `domain`; raises DocumentError."""
    content, cut = _read(path)
    numbers = [int(name.rpartition("-")[2]) for name in cut.ids if name.startswith(f"{domain}-")]
    name = f"{domain}-{max(numbers, default=0) + 1:02}"
    text = _FORM.format(id=name, domain=domain)
    return OpenRule(path, _sha256(content), "", text, 0, cut.ids)


def save_rule(opened: OpenRule, text: str, *, anyway: bool = False) -> OpenRule:
    """Put `text` into the file in the place of the opened rule; return the rule as it is saved.

    All else in the file stays byte for byte. Raises RulesChangedError when the file was changed
    since it was opened, unless `anyway`: then this rule alone is put into what the file is now.
    Raises DocumentError when the set would not be whole or the rule is gone, OSError when the file
    cannot be written; nothing is changed then.
    """

    def change(cut: RuleText) -> str:
        return cut.put(opened.id, text) if opened.id else cut.add(text)

    return _replace(opened, change, anyway=anyway)


def remove_rule(opened: OpenRule, *, anyway: bool = False) -> OpenRule:
    """Take the opened rule out of the file; like save_rule, with ValueError for the only rule."""
    return _replace(opened, lambda cut: cut.remove(opened.id), anyway=anyway)


def _replace(opened: OpenRule, change: Callable[[RuleText], str], *, anyway: bool) -> OpenRule:
    path = opened.path
    content, cut = _read(path)
    if _sha256(content) != opened.sha256 and not anyway:
        same = opened.id not in cut.ids or cut.rule(opened.id) != opened.text
        raise RulesChangedError(path, same_rule=bool(opened.id) and same)
    if opened.id:
        _known(cut, opened.id)
    new = change(cut)
    found = _checked(path, cut, new, opened.id)
    written = new.encode()
    if written != content:
        _write(path, written)
    after = RuleText(str(path), new)
    if not found:
        return OpenRule(path, _sha256(written), "", "", 0, after.ids)
    text = after.rule(found)
    others = _others(after, found)
    return OpenRule(path, _sha256(written), found, text, after.line(found), others)


def _checked(path: Path, before: RuleText, new: str, rule_id: str) -> str:
    """Return the id that the rule has in the file's text `new`, '' when it is gone.

    Raises DocumentError when the set is not whole, or when another rule would change.
    """
    document = Document(str(path), new)
    rule_set = parse_rule_set(document)
    compile_rule_set(document, rule_set)
    old = parse_rule_set(Document(str(path), before.text))
    ids = [rule.id for rule in rule_set.rules]
    added = [name for name in ids if name not in before.ids]
    touched = {rule_id, *added}
    for other in compare_rules(old, rule_set):
        if other.part != "rule" or other.id not in touched:
            problem = f"this would change {other.id or 'the head'} of the file too; not saved"
            raise DocumentError(str(path), 0, rule_id, problem)
    if len(added) > 1:
        raise DocumentError(str(path), 0, rule_id, f"one rule at a time: {', '.join(added)}")
    return added[0] if added else rule_id if rule_id in ids else ""


def _write(path: Path, content: bytes) -> None:
    """Let `path` hold `content`: a new file takes its place once it is whole on the disk."""
    path = path.resolve()
    mode = stat.S_IMODE(path.stat().st_mode)
    if not mode & 0o222 or not os.access(path, os.W_OK):
        raise PermissionError(13, "the file is read-only", str(path))
    number, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, mode)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise


def _read(path: Path) -> tuple[bytes, RuleText]:
    content = read_bytes(path)
    return content, RuleText(str(path), content.decode())


def _known(cut: RuleText, rule_id: str) -> None:
    if rule_id not in cut.ids:
        raise DocumentError(cut.source, 0, rule_id, "the file has no such rule any more")


def _others(cut: RuleText, rule_id: str) -> tuple[str, ...]:
    return tuple(name for name in cut.ids if name != rule_id)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


_FORM = """\
id: {id}
domain: {domain}
priority: high
text: "What must or must not be, in one sentence."
tags: []
# A guard: the check is made only where it holds. Leave it out to check every plan.
applies: "size(actions) > 0"
# What must hold: true, or an empty list of offenders, which are put after the message.
check: |-
  actions
    .filter(a, a.verb == 'move_to' && a.goes_to == 'Nowhere')
    .map(a, a.agent)
message: "what is wrong, of these"
examples:
  - name: keeps to it
    expect: pass
    plan: [[Drone_T04, observe WestGate]]
  - name: breaks it
    expect: fail
    plan: [[Drone_T04, move_to Nowhere]]
"""
