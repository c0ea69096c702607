"""Strict parsing of YAML documents into schema models, with errors that name place and remedy.

A file of a few hundred bytes can expand to gigabytes, because an alias repeats everything under its
anchor, and anchors may contain aliases. Nodes and text are therefore counted from the parser's
events, and an alias is counted at every use.

All files that the program did not write itself are read here: rules and their signatures, worlds,
scenarios, mission sets, settings, `--event`. The cost of reading them is limited.
"""

import errno
import hashlib
import json
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

import yaml
from pydantic import BaseModel, ValidationError
from yaml.constructor import SafeConstructor
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

from pa_console.schema.text import obeyed, visible_line

MOST_BYTES = 1_000_000
"""The size limit of a document's file, in bytes of UTF-8."""
MOST_NODES = 30_000
"""The limit on values and keys, counted again for each alias; usual files have a tenth as many."""
MOST_TEXT = 2_000_000
"""The limit on characters of text, counted again for each alias."""
MOST_DEPTH = 40
"""The limit on the depth of nested lists and mappings."""
MOST_KEY = 200
"""The limit on the characters of a key."""
TOO_LONG = f"longer than {MOST_BYTES:,} bytes; split it into several files"

_NAMED_FIELD = re.compile(r"^Value error, (\w+(?:\.\w+)*): (.*)$", re.DOTALL)
"""The form of an error in which a model's own validator names a field."""
_PLAIN_PROBLEMS = {
    "model_type": "fields are expected here, each as 'name: value'",
    "dict_type": "fields are expected here, each as 'name: value'",
    "list_type": "a list is expected here, with '- ' before each entry",
    "extra_forbidden": "there is no such field; remove it, or correct its name",
}
"""Plainer words for pydantic's errors, by the type of the error."""
_TAG = "tag:yaml.org,2002:"
_LONGEST_NUMBER = 64
_LONGEST_FIELD = 200
_LONGEST_PROBLEM = 2000

_SCALARS = SafeConstructor()


class TreeError(Exception):
    """An error in a text that cannot be parsed; line and column count from 1, 0 if unknown."""

    def __init__(self, problem: str, line: int = 0, column: int = 0) -> None:
        super().__init__(problem)
        self.problem, self.line, self.column = problem, line, column


def compose(text: str) -> yaml.Node | None:
    """Return the root of the one document in `text`, or None if the text is empty.

    Every key of the tree is a plain scalar, no node has an explicit tag, and an alias is the same
    node as its anchor. Raises TreeError if the text is not YAML or too large, or if it has tags or
    merged fields.
    """
    try:
        _measure(text)
        return yaml.compose(text, Loader=yaml.CSafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        words = ", ".join(part for part in (error.context, error.problem) if part)
        last = text.count("\n") + 1  # the parser reports the end of the text as an extra line
        place = (min(mark.line + 1, last), mark.column + 1) if mark is not None else ()
        if mark is not None and text[mark.index : mark.index + 1] == "\t":
            words = "the line is indented with a tab; use spaces"
        raise TreeError(f"not valid YAML: {words}", *place) from error
    except (yaml.YAMLError, ValueError) as error:
        raise TreeError(f"not valid YAML: {error}") from error


@dataclass
class _Size:
    """The size of a node with all its aliases expanded; `height` counts its levels."""

    nodes: int = 1
    text: int = 0
    height: int = 1

    def add(self, inner: "_Size") -> None:
        """Add the size of a node directly within this one."""
        self.nodes += inner.nodes
        self.text += inner.text
        self.height = max(self.height, inner.height + 1)


@dataclass
class _OpenCollection:
    """A list or mapping whose end has not been parsed yet."""

    anchor: str | None
    mapping: bool
    size: _Size
    children: int = 0


def _measure(text: str) -> None:
    """Raise TreeError as soon as `text` exceeds a limit or contains more than plain values."""
    if len(text) > MOST_BYTES or len(text.encode("utf-8", "replace")) > MOST_BYTES:
        raise TreeError(TOO_LONG)
    count = _EventCount()
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        count.take(event)


class _EventCount:
    """A count of a document's nodes and text, from the events of its parser."""

    def __init__(self) -> None:
        self._open: list[_OpenCollection] = []
        self._anchors: dict[str, _Size | None] = {}
        self._nodes = self._text = self._documents = 0

    def take(self, event: Event) -> None:
        """Count one event; raises TreeError if a limit is exceeded or the event is not allowed."""
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
                    raise _refused(
                        event, "a second document begins here, but a file may have only one"
                    )
            case _:
                pass

    def _is_key(self) -> bool:
        """Return whether the node that begins now is the key of a mapping."""
        return bool(self._open) and self._open[-1].mapping and self._open[-1].children % 2 == 0

    def _literal(self, event: NodeEvent, tag: str | None) -> None:
        """Refuse an explicit tag, because it changes the meaning of a value."""
        if tag is not None:
            raise _refused(event, f"the tag {tag[:40]!r} is not allowed; write only the value")

    def _begin(self, event: CollectionStartEvent) -> None:
        """Open a list or a mapping."""
        if self._is_key():
            raise _refused(event, "a list or a mapping cannot be a key; use text")
        self._within(event, 1, 0, 1)
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        self._open.append(
            _OpenCollection(event.anchor, isinstance(event, MappingStartEvent), _Size())
        )

    def _anchored(self, event: AliasEvent) -> _Size:
        """Return the size of an alias's anchor."""
        if self._is_key():
            raise _refused(event, "an alias cannot be a key; write the key itself")
        anchor = cast(str, event.anchor)
        if anchor not in self._anchors:
            raise _refused(event, f"no '&{anchor[:40]}' comes before '*{anchor[:40]}'")
        size = self._anchors[anchor]
        if size is None:
            raise _refused(event, f"'*{anchor[:40]}' is within its own anchor")
        return size

    def _add(self, event: NodeEvent, size: _Size, anchor: str | None) -> None:
        """Count a scalar or an alias."""
        self._within(event, size.nodes, size.text, size.height - 1)
        self._close(size, anchor)

    def _within(self, event: NodeEvent, nodes: int, text: int, levels: int) -> None:
        """Add to the totals; raises TreeError if one of them exceeds its limit."""
        self._nodes += nodes
        self._text += text
        counted = "each alias counted at every use; split it up"
        if self._nodes > MOST_NODES:
            raise _refused(event, f"the file has more than {MOST_NODES:,} values, {counted}")
        if self._text > MOST_TEXT:
            raise _refused(event, f"the file has more than {MOST_TEXT:,} characters, {counted}")
        if len(self._open) + levels > MOST_DEPTH:
            raise _refused(
                event, f"values are nested more than {MOST_DEPTH} levels deep; use fewer levels"
            )

    def _close(self, size: _Size, anchor: str | None) -> None:
        """Add a complete node to the node that contains it."""
        if anchor is not None:
            self._anchors[anchor] = size
        if self._open:
            self._open[-1].children += 1
            self._open[-1].size.add(size)


def _check_key(event: ScalarEvent) -> None:
    """Refuse a key that merges fields or is too long."""
    if event.value == "<<" and not event.style:
        raise _refused(event, "'<<' merges other fields; write the fields themselves")
    if len(event.value) > MOST_KEY:
        raise _refused(event, f"a key is longer than {MOST_KEY} characters")


def _refused(event: Event, problem: str) -> TreeError:
    mark = cast(yaml.Mark, event.start_mark)
    return TreeError(problem, mark.line + 1, mark.column + 1)


Model = TypeVar("Model", bound=BaseModel)
FieldPath = tuple[str | int, ...]
Value = str | int | float | bool | list["Value"] | dict[str | int, "Value"] | None


class DocumentError(Exception):
    """An error in a file that cannot be used, in words for the person who wrote the file.

    `source` is the file and `field` the dotted path of the field. `line` and `column` count from 1;
    0 if unknown.
    """

    def __init__(self, source: str, line: int, field: str, problem: str, column: int = 0) -> None:
        field, problem = _short(field, _LONGEST_FIELD), _short(problem, _LONGEST_PROBLEM)
        self.source, self.line, self.field, self.problem = source, line, field, problem
        self.column = column
        place = f"{source}:{line}" if line else source
        super().__init__(f"{place}: {field + ': ' if field else ''}{problem}")


class Document:
    """A parsed YAML file that also has the line of each field.

    `value` is built from the tree `root`; both are None for an empty file. `sha256` is the hash of
    the content.
    """

    def __init__(self, source: str, text: str) -> None:
        """Parse `text`; raises DocumentError if `compose` refuses it or a value is not allowed."""
        self.source = source
        self.sha256 = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
        try:
            self.root = compose(text)
        except TreeError as error:
            raise DocumentError(source, error.line, "", error.problem, error.column) from error
        first = 1 if self.root is None else self.root.start_mark.line + 1
        self._lines: dict[FieldPath, int] = {(): first}
        self.value: Value = None if self.root is None else self._built(self.root, ())

    @classmethod
    def read(cls, path: Path) -> "Document":
        """Read the file at `path`; raises DocumentError if it cannot be read or parsed."""
        return cls(str(path), read_text(path))

    def line(self, field: FieldPath) -> int:
        """Return the 1-based line of `field`, or of its nearest enclosing field."""
        while field not in self._lines:
            field = field[:-1]
        return self._lines[field]

    def error(self, field: FieldPath, problem: str) -> DocumentError:
        """Return a DocumentError with `problem` for `field`."""
        return DocumentError(self.source, self.line(field), ".".join(map(str, field)), problem)

    def parse(self, model: type[Model]) -> Model:
        """Validate the whole document as `model`; raises DocumentError for the first bad field."""
        try:
            return model.model_validate_json(json.dumps(self.value, ensure_ascii=False))
        except ValidationError as error:
            if self.value is None:
                raise self.error((), "the file is empty") from error
            first = error.errors(include_url=False, include_context=False, include_input=False)[0]
            field = self._written(first["loc"])
            problem = _PLAIN_PROBLEMS.get(first["type"], first["msg"])
            named = _NAMED_FIELD.match(problem)
            problem = problem.removeprefix("Value error, ")
            if named is not None:
                parts = (int(part) if part.isdigit() else part for part in named[1].split("."))
                field, problem = (*field, *parts), named[2]
            raise self.error(field, problem) from error

    def _written(self, field: FieldPath) -> FieldPath:
        """Return the path of `field` in the file, without the union tags that pydantic adds."""
        kept: FieldPath = ()
        for number, part in enumerate(field, start=1):
            if (*kept, part) in self._lines or number == len(field):
                kept = (*kept, part)
        return kept

    def _built(self, node: yaml.Node, field: FieldPath) -> Value:
        """Return the value of `node` and record its line; an alias is built anew at each use."""
        self._lines.setdefault(field, node.start_mark.line + 1)
        if isinstance(node, yaml.SequenceNode):
            return [self._built(child, (*field, place)) for place, child in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            values: dict[str | int, Value] = {}
            for key, child in cast(list[tuple[yaml.ScalarNode, yaml.Node]], node.value):
                name = self._key(key, field)
                path = (*field, str(name))
                if path in self._lines:
                    raise self._wrong(key, path, "the key appears twice")
                self._lines[path] = key.start_mark.line + 1
                values[name] = self._built(child, path)
            return values
        return self._scalar(cast(yaml.ScalarNode, node), field)

    def _key(self, node: yaml.ScalarNode, field: FieldPath) -> str | int:
        """Return the value of `node`, a key of the mapping `field`: text or a whole number."""
        name = self._scalar(node, (*field, node.value))
        if isinstance(name, bool) or not isinstance(name, str | int):
            problem = f"this key is read as {name!r}, not as text; put it in quotes"
            raise self._wrong(node, (*field, node.value), problem)
        return name

    def _scalar(self, node: yaml.ScalarNode, field: FieldPath) -> Value:
        """Return text, a number, true, false or None; raises DocumentError for anything else."""
        written: str = node.value
        match node.tag.removeprefix(_TAG):
            case "str":
                if (character := obeyed(written)) != "":
                    problem = f"contains {character}, which controls a terminal; remove it"
                    raise self._wrong(node, field, problem)
                return written
            case "null":
                return None
            case "bool":
                return _SCALARS.construct_yaml_bool(node)
            case "int" | "float" as kind if len(written) <= _LONGEST_NUMBER:
                whole = kind == "int"
                try:
                    return (
                        _SCALARS.construct_yaml_int(node)
                        if whole
                        else _SCALARS.construct_yaml_float(node)
                    )
                except (ValueError, OverflowError) as error:
                    raise self._wrong(node, field, f"not a number: {error}") from error
            case "int" | "float":
                problem = f"a number may have at most {_LONGEST_NUMBER} digits; put text in quotes"
                raise self._wrong(node, field, problem)
            case kind:
                problem = f"this is read as a {kind}, not as text; put it in quotes"
                raise self._wrong(node, field, problem)

    def _wrong(self, node: yaml.Node, field: FieldPath, problem: str) -> DocumentError:
        line = node.start_mark.line + 1
        return DocumentError(self.source, line, ".".join(map(str, field)), problem)


def read_text(path: Path) -> str:
    """Return the text of the file at `path` with its line ends unchanged.

    Raises DocumentError if the file is missing, not a regular file, longer than MOST_BYTES, or not
    UTF-8.
    """
    return read_bytes(path).decode()


def read_bytes(path: Path) -> bytes:
    """Return the content of the file at `path`, which is UTF-8; raises errors like `read_text`."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise DocumentError(
                    str(path), 0, "", "not a regular file; give the path of a regular file"
                )
            content = file.read(MOST_BYTES + 1)
        content.decode()
    except OSError as error:
        remedy = "; give the path of a file" if error.errno == errno.EISDIR else ""
        raise DocumentError(str(path), 0, "", f"{error.strerror or error}{remedy}") from error
    except UnicodeDecodeError as error:
        raise DocumentError(str(path), 0, "", "not UTF-8 text; save it as UTF-8") from error
    if len(content) > MOST_BYTES:
        raise DocumentError(str(path), 0, "", TOO_LONG)
    return content


def _short(text: str, most: int) -> str:
    """Return `text` as one printable line, cut off after `most` characters."""
    return visible_line(text if len(text) <= most else text[:most] + " ...")
