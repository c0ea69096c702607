"""Errors in a file name the file, the line and the field, and are worded for its author."""

from contextlib import suppress
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.schema.base import Positive, StrictModel
from pa_console.schema.document import Document, DocumentError


class Part(StrictModel):
    """An entry of a file."""

    kind: Literal["bolt", "nut"]
    size_mm: Positive = 1.0


class Box(StrictModel):
    """A file with nesting of both sorts."""

    name: str
    parts: tuple[Part, ...] = ()
    labels: dict[str, Part] = {}


SOUND = """\
name: a box
parts:
  - kind: bolt
    size_mm: 2.5
  - kind: nut
labels:
  red: {kind: nut}
"""


def error_of(text: str) -> DocumentError:
    with pytest.raises(DocumentError) as caught:
        Document("box.yaml", text).parse(Box)
    return caught.value


def test_a_sound_file_is_read() -> None:
    box = Document("box.yaml", SOUND).parse(Box)
    assert box.parts == (Part(kind="bolt", size_mm=2.5), Part(kind="nut"))
    assert box.labels == {"red": Part(kind="nut")}


@pytest.mark.parametrize(
    ("old", "new", "line", "field", "problem"),
    [
        ("size_mm: 2.5", "size_mm: -1", 4, "parts.0.size_mm", "greater than 0"),
        ("size_mm: 2.5", "size_mm: .nan", 4, "parts.0.size_mm", "finite"),
        ("size_mm: 2.5", "size_mm: '2.5'", 4, "parts.0.size_mm", "number"),
        ("size_mm: 2.5", "size: 2.5", 4, "parts.0.size", "no such field"),
        ("  - kind: nut", "  - kind: screw", 5, "parts.1.kind", "'bolt' or 'nut'"),
        ("  - kind: nut", "  - size_mm: 1", 5, "parts.1.kind", "required"),
        ("kind: nut}", "kind: glue}", 7, "labels.red.kind", "'bolt' or 'nut'"),
        ("name: a box", "name: [1]", 1, "name", "string"),
        ("name: a box\n", "", 1, "name", "required"),
    ],
)
def test_a_bad_field_is_named_with_its_line(
    old: str, new: str, line: int, field: str, problem: str
) -> None:
    error = error_of(SOUND.replace(old, new, 1))
    assert (error.source, error.line, error.field) == ("box.yaml", line, field)
    assert problem in error.problem
    assert str(error) == f"box.yaml:{line}: {field}: {error.problem}"


@pytest.mark.parametrize(
    ("text", "line", "key"),
    [
        ("name: a\nname: b\n", 2, "name"),
        ("name: a\nlabels:\n  x: {kind: nut}\n  y: {kind: nut}\n  x: {kind: bolt}\n", 5, "x"),
        ("name: a\nparts:\n  - kind: nut\n    kind: bolt\n", 4, "kind"),
    ],
)
def test_a_key_that_appears_twice_is_refused(text: str, line: int, key: str) -> None:
    error = error_of(text)
    assert (error.line, error.field.split(".")[-1]) == (line, key)
    assert "twice" in error.problem


@pytest.mark.parametrize(
    ("text", "line"), [("name: [a\n", 2), ("name: a\n\tparts: 1\n", 2), ("a: b: c\n", 1)]
)
def test_broken_yaml_is_reported_with_its_line(text: str, line: int) -> None:
    error = error_of(text)
    assert error.line == line
    assert "not valid YAML" in error.problem


@pytest.mark.parametrize(
    ("text", "problem"), [("name: a\n\tparts: 1\n", "use spaces"), ("", "the file is empty")]
)
def test_a_tab_and_an_empty_document_are_called_what_they_are(text: str, problem: str) -> None:
    assert problem in error_of(text).problem


@pytest.mark.parametrize(
    "text",
    [
        "",
        "just text",
        "- a list",
        "name: 2026-01-01\n",
        "name: !!python/object:os.system x\n",
        "{name: a, ? [x] : y}",
        "name: a\n1: 2\n",
        "? {a: b}\n: c\n",
        "a: &x [*x]\n",
        "&a [*a]",
        "--- a\n--- b\n",
        "name: \x00\n",
        "<<: 5\n",
        pytest.param("name: a\nparts: " + "[" * 2000, id="deep nesting"),
    ],
)
def test_odd_yaml_is_an_error_for_files_and_never_a_crash(text: str) -> None:
    assert error_of(text).source == "box.yaml"


@given(st.text(st.sampled_from("ab:-?&*!|>[]{}#'\",\n \t1.~<%@`"), max_size=40))
def test_any_text_is_a_document_or_an_error_for_files(text: str) -> None:
    with suppress(DocumentError):
        Document("box.yaml", text).parse(Box)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match=r"none\.yaml: No such file"):
        Document.read(tmp_path / "none.yaml")
    with pytest.raises(DocumentError, match="directory"):
        Document.read(tmp_path)


def test_a_file_that_is_not_utf8_is_named(tmp_path: Path) -> None:
    path = tmp_path / "latin.yaml"
    path.write_bytes("name: Zürich\n".encode("latin-1"))
    with pytest.raises(DocumentError, match=r"latin\.yaml: not UTF-8 text; save it"):
        Document.read(path)
