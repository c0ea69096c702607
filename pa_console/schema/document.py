"""Reads YAML documents strictly into schema models; errors name file, line, field and remedy."""

import json
import re
from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError

Model = TypeVar("Model", bound=BaseModel)
FieldPath = tuple[str | int, ...]

_NAMED_FIELD = re.compile(r"^Value error, (\w+(?:\.\w+)*): (.*)$", re.DOTALL)
"""How a model's own validator names the field that it objects to."""


class DocumentError(Exception):
    """A file that cannot be used, worded for the person who wrote it.

    `source` is the file, `line` the 1-based line (0 when unknown), `field` the dotted path.
    """

    def __init__(self, source: str, line: int, field: str, problem: str) -> None:
        self.source, self.line, self.field, self.problem = source, line, field, problem
        place = f"{source}:{line}" if line else source
        super().__init__(f"{place}: {field + ': ' if field else ''}{problem}")


class Document:
    """A parsed YAML file that still knows on which line each field stands."""

    def __init__(self, source: str, text: str) -> None:
        """Parse `text`; raises DocumentError for YAML that is broken or repeats a key."""
        self.source = source
        self._lines: dict[FieldPath, int] = {(): 1}
        try:
            node = yaml.compose(text, Loader=yaml.SafeLoader)
            self.value = yaml.safe_load(text)
            if node is not None:
                self._index(node, ())
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            problem = f"not valid YAML: {error.problem or error.context}"
            raise DocumentError(source, mark.line + 1 if mark else 0, "", problem) from error
        except (yaml.YAMLError, ValueError) as error:
            raise DocumentError(source, 0, "", f"not valid YAML: {error}") from error
        except RecursionError as error:
            raise DocumentError(source, 0, "", "nested too deeply, or contains itself") from error

    @classmethod
    def read(cls, path: Path) -> "Document":
        """Read the file at `path`; raises DocumentError when it is missing or not UTF-8."""
        try:
            return cls(str(path), path.read_text(encoding="utf-8"))
        except OSError as error:
            raise DocumentError(str(path), 0, "", error.strerror or str(error)) from error
        except UnicodeDecodeError as error:
            raise DocumentError(str(path), 0, "", "the file is not UTF-8 text") from error

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
            return model.model_validate_json(json.dumps(self.value))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field, problem = self._written(first["loc"]), first["msg"]
            named = _NAMED_FIELD.match(problem)
            if named is not None:
                parts = (int(part) if part.isdigit() else part for part in named[1].split("."))
                field, problem = (*field, *parts), named[2]
            raise self.error(field, problem) from error
        except TypeError as error:
            problem = f"only text, numbers, lists and mappings are allowed: {error}"
            raise DocumentError(self.source, 0, "", problem) from error

    def _written(self, field: FieldPath) -> FieldPath:
        """Return `field` as the file has it: without the tags of unions that pydantic puts in."""
        kept: FieldPath = ()
        for number, part in enumerate(field, start=1):
            if (*kept, part) in self._lines or number == len(field):
                kept = (*kept, part)
        return kept

    def _index(self, node: yaml.Node, field: FieldPath) -> None:
        self._lines[field] = node.start_mark.line + 1
        if isinstance(node, yaml.SequenceNode):
            for index, child in enumerate(node.value):
                self._index(child, (*field, index))
        elif isinstance(node, yaml.MappingNode):
            for key, child in node.value:
                path = (*field, key.value)
                if path in self._lines:
                    line = key.start_mark.line + 1
                    raise DocumentError(self.source, line, key.value, "the key appears twice")
                self._index(child, path)
                self._lines[path] = key.start_mark.line + 1
