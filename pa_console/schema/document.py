"""Reads YAML documents strictly into schema models; errors name file, line, field and remedy.

Every file that is not written by the program itself comes through here: rules and their signature,
worlds, scenarios, mission sets, settings, `--event`. What it may cost is limited (`yaml_tree`).
"""

import hashlib
import json
import os
import re
import stat
from pathlib import Path
from typing import TypeVar, cast

import yaml
from pydantic import BaseModel, ValidationError
from yaml.constructor import SafeConstructor

from pa_console.schema.visible import obeyed, visible_line
from pa_console.schema.yaml_tree import MOST_BYTES, TOO_LONG, TreeError, compose

Model = TypeVar("Model", bound=BaseModel)
FieldPath = tuple[str | int, ...]
Value = str | int | float | bool | list["Value"] | dict[str | int, "Value"] | None

_NAMED_FIELD = re.compile(r"^Value error, (\w+(?:\.\w+)*): (.*)$", re.DOTALL)
"""How a model's own validator names the field that it objects to."""
_TAG = "tag:yaml.org,2002:"
_LONGEST_NUMBER = 64
_LONGEST_FIELD = 200
_LONGEST_PROBLEM = 2000
_SCALARS = SafeConstructor()


class DocumentError(Exception):
    """A file that cannot be used, worded for the person who wrote it.

    `source` is the file, `line` the 1-based line (0 when unknown), `field` the dotted path,
    `column` the 1-based column where that is known.
    """

    def __init__(self, source: str, line: int, field: str, problem: str, column: int = 0) -> None:
        field, problem = _short(field, _LONGEST_FIELD), _short(problem, _LONGEST_PROBLEM)
        self.source, self.line, self.field, self.problem = source, line, field, problem
        self.column = column
        place = f"{source}:{line}" if line else source
        super().__init__(f"{place}: {field + ': ' if field else ''}{problem}")


class Document:
    """A parsed YAML file that still knows on which line each field stands.

    `root` is the tree that it was read from, None for an empty file; `sha256` is its content's.
    """

    def __init__(self, source: str, text: str) -> None:
        """Parse `text`; raises DocumentError for YAML that is broken, too large or not literal."""
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
        """Read the file at `path`; raises DocumentError when it is missing or not UTF-8."""
        return cls(str(path), read_text(path))

    def line(self, field: FieldPath) -> int:
        """Return the 1-based line of `field`, or of its nearest enclosing field."""
        while field not in self._lines:
            field = field[:-1]
        return self._lines[field]

    def error(self, field: FieldPath, problem: str) -> DocumentError:
        """Return the error that says `problem` about `field`."""
        return DocumentError(self.source, self.line(field), ".".join(map(str, field)), problem)

    def parse(self, model: type[Model]) -> Model:
        """Validate the whole document as `model`; raises DocumentError at the first bad field."""
        try:
            return model.model_validate_json(json.dumps(self.value, ensure_ascii=False))
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False, include_input=False)[0]
            field, problem = self._written(first["loc"]), first["msg"]
            named = _NAMED_FIELD.match(problem)
            problem = problem.removeprefix("Value error, ")
            if named is not None:
                parts = (int(part) if part.isdigit() else part for part in named[1].split("."))
                field, problem = (*field, *parts), named[2]
            raise self.error(field, problem) from error

    def _written(self, field: FieldPath) -> FieldPath:
        """Return `field` as the file has it: without the tags of unions that pydantic puts in."""
        kept: FieldPath = ()
        for number, part in enumerate(field, start=1):
            if (*kept, part) in self._lines or number == len(field):
                kept = (*kept, part)
        return kept

    def _built(self, node: yaml.Node, field: FieldPath) -> Value:
        """Return what `node` says, its line noted; an alias is built anew wherever it stands."""
        self._lines.setdefault(field, node.start_mark.line + 1)
        if isinstance(node, yaml.SequenceNode):
            return [self._built(child, (*field, place)) for place, child in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            found: dict[str | int, Value] = {}
            for key, child in cast(list[tuple[yaml.ScalarNode, yaml.Node]], node.value):
                name = self._key(key, field)
                path = (*field, str(name))
                if path in self._lines:
                    raise self._wrong(key, path, "the key appears twice")
                self._lines[path] = key.start_mark.line + 1
                found[name] = self._built(child, path)
            return found
        return self._scalar(cast(yaml.ScalarNode, node), field)

    def _key(self, node: yaml.ScalarNode, field: FieldPath) -> str | int:
        """Return the key `node` of the mapping `field`: text, or a whole number."""
        name = self._scalar(node, (*field, node.value))
        if isinstance(name, bool) or not isinstance(name, str | int):
            problem = f"this key is read as {name!r}, not as text; put it in quotes"
            raise self._wrong(node, (*field, node.value), problem)
        return name

    def _scalar(self, node: yaml.ScalarNode, field: FieldPath) -> Value:
        """Return text, a number, true, false or nothing; raises DocumentError for all else."""
        written: str = node.value
        match node.tag.removeprefix(_TAG):
            case "str":
                if (character := obeyed(written)) != "":
                    problem = f"holds {character}, which a terminal obeys; take it out"
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
                problem = f"a number has at most {_LONGEST_NUMBER} digits; put text in quotes"
                raise self._wrong(node, field, problem)
            case kind:
                problem = f"this is read as a {kind}, not as text; put it in quotes"
                raise self._wrong(node, field, problem)

    def _wrong(self, node: yaml.Node, field: FieldPath, problem: str) -> DocumentError:
        line = node.start_mark.line + 1
        return DocumentError(self.source, line, ".".join(map(str, field)), problem)


def read_text(path: Path) -> str:
    """Return the text of the file at `path`, its line ends as they are.

    Raises DocumentError when it is missing, no plain file, too long or not UTF-8; no more of it is
    read than a document may have.
    """
    return read_bytes(path).decode()


def read_bytes(path: Path) -> bytes:
    """Return the content of the file at `path`, which is UTF-8; raises DocumentError likewise."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise DocumentError(str(path), 0, "", "not a plain file; give the path of one")
            content = file.read(MOST_BYTES + 1)
        content.decode()
    except OSError as error:
        raise DocumentError(str(path), 0, "", error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise DocumentError(str(path), 0, "", "the file is not UTF-8 text") from error
    if len(content) > MOST_BYTES:
        raise DocumentError(str(path), 0, "", TOO_LONG)
    return content


def _short(text: str, most: int) -> str:
    """Return `text` on one line as a person can read it, its end left out where it is too long."""
    return visible_line(text if len(text) <= most else text[:most] + " ...")
