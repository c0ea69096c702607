"""Composes YAML into a tree of nodes, within limits that hold before anything large is built.

A file of a few hundred bytes can mean gigabytes: an alias stands for all that its anchor holds, and
aliases may stand within anchors. So the nodes and the text are counted as they will be read, every
alias as often as it is used, while the parser's events go by.
"""

from dataclasses import dataclass
from typing import cast

import yaml
from yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    Event,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
)

MOST_BYTES = 1_000_000
"""A document's file may be this long, bytes of UTF-8."""
MOST_NODES = 30_000
"""Its values and keys, as often as aliases repeat them; honest files have a tenth of it."""
MOST_TEXT = 2_000_000
"""Its text, counted likewise, characters."""
MOST_DEPTH = 40
"""Lists and mappings within each other."""
MOST_KEY = 200
"""A key may be this long, characters."""
TOO_LONG = f"longer than {MOST_BYTES:,} bytes; no such file needs to be, so split it up"


class TreeError(Exception):
    """Why a text is no tree that may be read; line and column from 1, 0 where unknown."""

    def __init__(self, problem: str, line: int = 0, column: int = 0) -> None:
        super().__init__(problem)
        self.problem, self.line, self.column = problem, line, column


def compose(text: str) -> yaml.Node | None:
    """Return the root of the one document in `text`, None when it is empty.

    Every key of the tree is a plain scalar, and no node has a tag that the file gives it. An alias
    is the node of its anchor. Raises TreeError for what is not YAML, too large, or not literal.
    """
    try:
        _measure(text)
        return yaml.compose(text, Loader=yaml.CSafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = ", ".join(part for part in (error.context, error.problem) if part)
        last = text.count("\n") + 1  # the end of the text is told as a line after it
        place = (min(mark.line + 1, last), mark.column + 1) if mark is not None else ()
        raise TreeError(f"not valid YAML: {said}", *place) from error
    except (yaml.YAMLError, ValueError) as error:
        raise TreeError(f"not valid YAML: {error}") from error


@dataclass
class _Size:
    """What a node holds when every alias in it is replaced; `height` counts its own level."""

    nodes: int = 1
    text: int = 0
    height: int = 1

    def add(self, inner: "_Size") -> None:
        """Take in a node that stands directly within this one."""
        self.nodes += inner.nodes
        self.text += inner.text
        self.height = max(self.height, inner.height + 1)


@dataclass
class _Open:
    """A list or mapping whose end has not come yet."""

    anchor: str | None
    mapping: bool
    size: _Size
    children: int = 0


def _measure(text: str) -> None:
    """Raise TreeError as soon as `text` passes a limit or does more than state values."""
    if len(text) > MOST_BYTES or len(text.encode("utf-8", "replace")) > MOST_BYTES:
        raise TreeError(TOO_LONG)
    count = _Count()
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        count.take(event)


class _Count:
    """Counts the events of a document."""

    def __init__(self) -> None:
        self._open: list[_Open] = []
        self._anchors: dict[str, _Size | None] = {}
        self._nodes = self._text = self._documents = 0

    def take(self, event: Event) -> None:
        """Count one event; raises TreeError when it is one too many."""
        match event:
            case ScalarEvent():
                self._literal(event, event.tag)
                if self._is_key():
                    _check_key(event)
                self._add(event, _Size(1, len(event.value), 1), event.anchor)
            case CollectionStartEvent():
                self._literal(event, event.tag)
                self._begin(event)
            case CollectionEndEvent():
                ended = self._open.pop()
                self._close(ended.size, ended.anchor)
            case AliasEvent():
                self._add(event, self._anchored(event), None)
            case DocumentStartEvent():
                self._documents += 1
                if self._documents > 1:
                    raise _refused(event, "a second document begins; a file holds one")
            case _:
                pass

    def _is_key(self) -> bool:
        """Whether the node that begins now is the key of a mapping."""
        return bool(self._open) and self._open[-1].mapping and self._open[-1].children % 2 == 0

    def _literal(self, event: NodeEvent, tag: str | None) -> None:
        """Refuse a tag: it makes a value something else than it says."""
        if tag is not None:
            raise _refused(event, f"the tag {tag[:40]!r} is not read; write the value alone")

    def _begin(self, event: CollectionStartEvent) -> None:
        """Open a list or a mapping."""
        if self._is_key():
            raise _refused(event, "a key is a list or a mapping; only text can be a key")
        self._within(event, 1, 0, 1)
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        self._open.append(_Open(event.anchor, isinstance(event, MappingStartEvent), _Size()))

    def _anchored(self, event: AliasEvent) -> _Size:
        """Return what an alias stands for."""
        if self._is_key():
            raise _refused(event, "an alias is a key; write the key itself")
        anchor = cast(str, event.anchor)
        if anchor not in self._anchors:
            raise _refused(event, f"no '&{anchor[:40]}' comes before '*{anchor[:40]}'")
        size = self._anchors[anchor]
        if size is None:
            raise _refused(event, f"'*{anchor[:40]}' stands within itself")
        return size

    def _add(self, event: NodeEvent, size: _Size, anchor: str | None) -> None:
        """Count a scalar or an alias."""
        self._within(event, size.nodes, size.text, size.height - 1)
        self._close(size, anchor)

    def _within(self, event: NodeEvent, nodes: int, text: int, levels: int) -> None:
        """Add to the totals; raises TreeError where one of them passes its limit."""
        self._nodes += nodes
        self._text += text
        counted = "each alias counted as often as it is used; split it up"
        if self._nodes > MOST_NODES:
            raise _refused(event, f"it comes to more than {MOST_NODES:,} values, {counted}")
        if self._text > MOST_TEXT:
            raise _refused(event, f"it comes to more than {MOST_TEXT:,} characters, {counted}")
        if len(self._open) + levels > MOST_DEPTH:
            raise _refused(event, f"nested deeper than {MOST_DEPTH} levels; flatten it")

    def _close(self, size: _Size, anchor: str | None) -> None:
        """Count a node that is whole now into the one around it."""
        if anchor is not None:
            self._anchors[anchor] = size
        if self._open:
            self._open[-1].children += 1
            self._open[-1].size.add(size)


def _check_key(event: ScalarEvent) -> None:
    """Refuse a key that is not literal."""
    if event.value == "<<" and not event.style:
        raise _refused(event, "'<<' merges fields unseen; write the fields themselves")
    if len(event.value) > MOST_KEY:
        raise _refused(event, f"a key is longer than {MOST_KEY} characters")


def _refused(event: Event, problem: str) -> TreeError:
    mark = cast(yaml.Mark, event.start_mark)
    return TreeError(problem, mark.line + 1, mark.column + 1)
