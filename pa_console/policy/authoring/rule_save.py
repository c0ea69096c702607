"""Opening one rule of a file, and saving it completely or not at all.

A change that was made to the file meanwhile is not lost. The file is changed as text: one rule is
replaced, added or removed, and the rest stays as it is.
"""

import hashlib
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import yaml

from pa_console.policy.authoring.differences import compare_rules
from pa_console.policy.rulebook import compile_rule_set, parse_rule_set
from pa_console.private_files import mode_of, replace_private
from pa_console.schema.document import Document, DocumentError, read_bytes

_FORM = """\
id: {id}
domain: {domain}
priority: high
text: "What must happen or must not happen, in one sentence."
tags: []
# A guard: the check is made only where it holds. Leave it out to check every plan.
applies: "size(actions) > 0"
# The check holds if it is true or an empty list; a list names the offenders for the message.
check: |-
  actions
    .filter(a, a.verb == 'move_to' && a.goes_to == 'Nowhere')
    .map(a, a.agent)
message: "these agents break the rule"
examples:
  - name: complies
    expect: pass
    plan: [[Drone_T04, observe WestGate]]
  - name: violates it
    expect: fail
    plan: [[Drone_T04, move_to Nowhere]]
"""


@dataclass(frozen=True)
class _Block:
    """The lines of one rule, as offsets into the file's text.

    `start` is the beginning of the comments directly above the rule, `dash` the line of its dash,
    `body` its first key, and `end` the end of its last line, including comments of its own.
    """

    id: str
    start: int
    dash: int
    body: int
    end: int


class RuleText:
    """The text of a rule file, split into its rules; the object itself never changes."""

    def __init__(self, source: str, text: str) -> None:
        """Split `text`, the content of the file `source`.

        Raises DocumentError if it is not YAML, or if its rules are not listed one below the other.
        """
        self.source, self.text = source, text
        self._newline = "\r\n" if "\r\n" in text else "\n"
        if "\r" in text.replace("\r\n", ""):
            raise self._error(0, "its lines end with CR only; use LF line ends to edit rules here")
        listed = self._listed()
        self._column = listed.start_mark.column
        self._blocks: list[_Block] = []
        for node in listed.value:
            self._blocks.append(self._block(node))

    @property
    def ids(self) -> tuple[str, ...]:
        """The id of every rule, in order; '' for a rule without an id."""
        return tuple(block.id for block in self._blocks)

    def rule(self, rule_id: str) -> str:
        """Return a rule as a separate YAML text, with the comments directly above it.

        Lines end in LF. Raises KeyError if the file has no such rule.
        """
        block = self._find(rule_id)
        above = _outdented(self.text[block.start : block.dash], self._column)
        indent = self._indent(block)
        body = " " * indent + self.text[block.body : block.end]
        return (above + _outdented(body, indent)).replace("\r\n", "\n")

    def line(self, rule_id: str) -> int:
        """Return the line of the file, from 1, on which the text of a rule begins."""
        return self.text.count("\n", 0, self._find(rule_id).start) + 1

    def put(self, rule_id: str, edited: str) -> str:
        """Return the file's text with a rule replaced by `edited`; an equal text changes nothing.

        Raises KeyError if the file has no such rule.
        """
        block = self._find(rule_id)
        if edited == self.rule(rule_id):
            return self.text
        above, body = _parts(edited)
        head = self.text[block.dash : block.body]
        new = self._written(above, self._column) + head
        new += self._written(body, self._indent(block))[self._indent(block) :]
        return self.text[: block.start] + self._ended(new, block.end) + self.text[block.end :]

    def add(self, edited: str) -> str:
        """Return the file's text with the new rule `edited` after the last one."""
        last = self._blocks[-1]
        above, body = _parts(edited)
        dash = " " * self._column + "- "
        new = self._written(above, self._column) + dash
        new += self._written(body, self._column + 2)[self._column + 2 :]
        before, after = self.text[: last.end], self.text[last.end :]
        if not before.endswith("\n"):
            before += self._newline
        gap = self._newline if self._spaced() else ""
        return before + gap + self._ended(new, last.end) + after

    def remove(self, rule_id: str) -> str:
        """Return the file's text without a rule and the empty lines after it.

        Raises KeyError if the file has no such rule, ValueError if it is the only one.
        """
        block = self._find(rule_id)
        if len(self._blocks) == 1:
            raise ValueError(f"{rule_id} is the only rule: a rule set has at least one")
        before, after = self.text[: block.start], self.text[block.end :]
        gap = re.match(r"(?:[ \t]*\r?\n)*", after)
        if block is not self._blocks[-1] and gap is not None:
            after = after[gap.end() :]
        else:
            before = re.sub(r"(?:(?<=\n)[ \t]*\r?\n)+\Z", "", before)
        return before + after

    def _listed(self) -> yaml.SequenceNode:
        """Return the node of the list `rules`."""
        root = Document(self.source, self.text).root
        fields = root.value if isinstance(root, yaml.MappingNode) else ()
        node = next((value for key, value in fields if key.value == "rules"), None)
        if not isinstance(node, yaml.SequenceNode) or not node.value:
            raise self._error(1, "expected a list of rules under 'rules:'")
        if node.flow_style:
            where = node.start_mark.line + 1
            raise self._error(where, "the rules are in [ ]; write them one below the other")
        return node

    def _block(self, node: yaml.Node) -> _Block:
        """Return the position of the rule `node`; the rules before it must have been read."""
        body = node.start_mark.index
        dash = self._line_start(body)
        while self.text[dash : dash + self._column].strip(" ") or (
            self.text[dash + self._column : dash + self._column + 1] != "-"
        ):
            if dash == 0:
                where = node.start_mark.line + 1
                raise self._error(where, "the start of this rule was not found; edit the file")
            dash = self._line_start(dash - 1)
        floor = self._blocks[-1].end if self._blocks else 0
        start = dash
        while start > floor:
            above = self._line_start(start - 1)
            line = self.text[above:start]
            if above < floor or not re.match(rf" {{{self._column}}}#", line):
                break
            start = above
        return _Block(_id_of(node), start, dash, body, self._end(node))

    def _end(self, node: yaml.Node) -> int:
        """Return the end of a rule's last line, including indented comments below it."""
        last = max(_ends(node))
        content = len(self.text[:last].rstrip())
        end = self._line_end(content)
        place = end
        while place < len(self.text):
            following = self._line_end(place)
            line = self.text[place:following]
            if line.strip() and not re.match(rf" {{{self._column + 1},}}#", line):
                break
            if line.strip():
                end = following
            place = following
        return end

    def _line_start(self, place: int) -> int:
        return self.text.rfind("\n", 0, place) + 1

    def _line_end(self, place: int) -> int:
        end = self.text.find("\n", place)
        return len(self.text) if end < 0 else end + 1

    def _indent(self, block: _Block) -> int:
        return block.body - self._line_start(block.body)

    def _spaced(self) -> bool:
        """Return whether the rules of the file are separated by empty lines."""
        if len(self._blocks) < 2:
            return True
        last, before = self._blocks[-1], self._blocks[-2]
        return not self.text[before.end : last.start].strip() and before.end < last.start

    def _written(self, text: str, indent: int) -> str:
        """Return `text` indented by `indent`, with the file's line ends; empty lines stay empty."""
        lines = (" " * indent + line if line else line for line in text.split("\n"))
        return self._newline.join(lines)

    def _ended(self, new: str, end: int) -> str:
        """Return `new` without trailing empty lines, with a line end if there was one before."""
        new = new.rstrip(" \t\r\n")
        return (
            new + self._newline if self.text[:end].endswith("\n") or end < len(self.text) else new
        )

    def _find(self, rule_id: str) -> _Block:
        for block in self._blocks:
            if block.id == rule_id:
                return block
        raise KeyError(rule_id)

    def _error(self, line: int, problem: str) -> DocumentError:
        return DocumentError(self.source, line, "rules" if line else "", problem)


def _ends(node: yaml.Node) -> Iterator[int]:
    """Yield the ends of all values in `node` except block collections, whose ends are not exact."""
    if isinstance(node, yaml.ScalarNode) or (
        isinstance(node, yaml.CollectionNode) and node.flow_style
    ):
        yield node.end_mark.index
    elif isinstance(node, yaml.SequenceNode):
        for child in node.value:
            yield from _ends(child)
    elif isinstance(node, yaml.MappingNode):
        for key, child in node.value:
            yield from _ends(key)
            yield from _ends(child)


def _id_of(node: yaml.Node) -> str:
    fields = node.value if isinstance(node, yaml.MappingNode) else ()
    return next((str(value.value) for key, value in fields if key.value == "id"), "")


def _parts(edited: str) -> tuple[str, str]:
    """Return the comments at the beginning of a rule's text, and the rest of the text."""
    text = edited.replace("\r\n", "\n").strip("\n") + "\n"
    match = re.match(r"(?:#[^\n]*\n|[ \t]*\n)*", text)
    at = match.end() if match is not None else 0
    return text[:at], text[at:]


def _outdented(text: str, indent: int) -> str:
    """Return `text` with up to `indent` spaces removed from each line."""
    return re.sub(rf"(?m)^ {{0,{indent}}}", "", text)


class RulesChangedError(ValueError):
    """A file that has changed since the rule was opened; with `same_rule`, so has the rule."""

    def __init__(self, path: Path, *, same_rule: bool) -> None:
        rule_state = "and so has this rule" if same_rule else "but not this rule"
        super().__init__(f"{path}: the file has changed in the meantime, {rule_state}")
        self.same_rule = same_rule


@dataclass(frozen=True)
class OpenRule:
    """A rule opened from the file `path`; `id` is empty for a rule that is not yet in it.

    `sha256` is the hash of the file when the rule was opened, `text` the text of the rule, `line`
    its first line in the file, and `taken` the ids of the other rules.
    """

    path: Path
    sha256: str
    id: str
    text: str
    line: int
    taken: tuple[str, ...]


def open_rule(path: Path, rule_id: str) -> OpenRule:
    """Open a rule of the file; raises DocumentError if the file or the rule cannot be read."""
    content, cut = _read(path)
    _refuse_missing(cut, rule_id)
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
    """Replace the opened rule in the file by `text`; return the rule as it is saved.

    Everything else in the file stays the same, byte for byte. Raises RulesChangedError if the file
    was changed since it was opened, unless `anyway` is set: then only this rule is replaced in the
    changed file. Raises DocumentError if the set would be invalid or the rule is gone, and OSError
    if the file cannot be written; in both cases nothing is changed.
    """

    def change(cut: RuleText) -> str:
        return cut.put(opened.id, text) if opened.id else cut.add(text)

    return _replace(opened, change, anyway=anyway)


def remove_rule(opened: OpenRule, *, anyway: bool = False) -> OpenRule:
    """Remove the opened rule from the file.

    Raises ValueError for the only rule, and otherwise the errors of `save_rule`.
    """
    return _replace(opened, lambda cut: cut.remove(opened.id), anyway=anyway)


def _replace(opened: OpenRule, change: Callable[[RuleText], str], *, anyway: bool) -> OpenRule:
    path = opened.path
    content, cut = _read(path)
    if _sha256(content) != opened.sha256 and not anyway:
        same = opened.id not in cut.ids or cut.rule(opened.id) != opened.text
        raise RulesChangedError(path, same_rule=bool(opened.id) and same)
    if opened.id:
        _refuse_missing(cut, opened.id)
    new = change(cut)
    checked = _checked(path, cut, new, opened.id)
    written = new.encode()
    if written != content:
        _write(path, written)
    after = RuleText(str(path), new)
    if not checked:
        return OpenRule(path, _sha256(written), "", "", 0, after.ids)
    text = after.rule(checked)
    others = _others(after, checked)
    return OpenRule(path, _sha256(written), checked, text, after.line(checked), others)


def _checked(path: Path, before: RuleText, new: str, rule_id: str) -> str:
    """Return the id that the rule has in the file's text `new`, or '' if it is gone.

    Raises DocumentError if the set is invalid, or if another rule would change.
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
            problem = f"this would also change {other.id or 'the head'} in the file; not saved"
            raise DocumentError(str(path), 0, rule_id, problem)
    if len(added) > 1:
        raise DocumentError(str(path), 0, rule_id, f"one rule at a time: {', '.join(added)}")
    return added[0] if added else rule_id if rule_id in ids else ""


def _write(path: Path, content: bytes) -> None:
    """Replace `path` with `content`: the new file takes its place once it is complete on disk."""
    path = path.resolve()
    mode = mode_of(path)
    if not mode & 0o222 or not os.access(path, os.W_OK):
        raise PermissionError(13, "the file is read-only", str(path))
    replace_private(path, content, mode)


def _read(path: Path) -> tuple[bytes, RuleText]:
    content = read_bytes(path)
    return content, RuleText(str(path), content.decode())


def _refuse_missing(cut: RuleText, rule_id: str) -> None:
    if rule_id not in cut.ids:
        raise DocumentError(cut.source, 0, rule_id, "the file no longer has this rule")


def _others(cut: RuleText, rule_id: str) -> tuple[str, ...]:
    return tuple(name for name in cut.ids if name != rule_id)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
