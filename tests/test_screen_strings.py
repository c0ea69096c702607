"""Every text that a screen or terminal shows; `python -m tests.test_screen_strings` prints them.

A text is found where it is written: a constant or an f-string that is more than one word, in the
packages that speak to people. Docstrings, patterns, CEL, style sheets and names of things are none.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from pa_console.schema.command import COMMANDS
from pa_console.settings.schema import Settings
from tests.glossary import retired_words, uses

ROOT = Path(__file__).parent.parent / "pa_console"
SPEAKING = (
    "api", "cli", "export", "fleets", "mission", "policy", "schema", "session", "settings",
    "sim/worlds", "station", "terminal", "tui", "views",
)  # fmt: skip
_SILENT_CALLS = frozenset(("compile", "sub", "search", "fullmatch", "match", "query", "query_one"))
_SILENT_ARGUMENTS = frozenset(("id", "classes", "pattern", "discriminator", "default_css"))
_SILENT_NAMES = frozenset(("DEFAULT_CSS", "CSS", "CORE", "_HEAD"))
_SILENT_FILES = (
    "fleets/authorization/verifier.py",
    "fleets/vda5050/site_files.py",
)
"""They write SQL and the configuration of a broker."""
_NO_WORDS = (
    re.compile(r"\{[^{}]*\}"),
    re.compile(r"`[^`]*`"),
    re.compile(r"pa-console (?:[^;,.\n]|\.(?=\S))*"),
    re.compile(r"\S*[=/\\\d]\S*"),
)
_WORDS = re.compile(r"[A-Za-z]{2,}[,;:.]? +[a-zA-Z{(]")
_ACTION = re.compile(r"\w+\(.*\)")
"""What a key of Textual does."""
_CEL = re.compile(r"\bit\.|&&|\bexists\(|==|\bmap\(")


class Shown(NamedTuple):
    """One text with its place; what is put into an f-string stands in braces."""

    file: str
    line: int
    text: str
    reprs: tuple[str, ...] = ()
    """What is put in as Python would write it."""


def shown_strings() -> list[Shown]:
    """Return every text of the packages that speak to people, by file and line."""
    found: list[Shown] = []
    for part in SPEAKING:
        place = ROOT / part
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            if str(path.relative_to(ROOT)) in _SILENT_FILES:
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            name = str(path.relative_to(ROOT.parent))
            described = not name.startswith("pa_console/schema/")
            found += (Shown(name, *each) for each in _texts(tree, described=described))
    return found


def _texts(tree: ast.AST, *, described: bool) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """Yield the texts below `tree` that people read; descriptions of fields where `described`."""
    for node in _heard(tree, described=described):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text, reprs = node.value, ()
        elif isinstance(node, ast.JoinedStr):
            text, reprs = _written(node), tuple(_reprs(node))
        else:
            continue
        if _WORDS.search(text) and not _CEL.search(text) and not _ACTION.fullmatch(text):
            yield node.lineno, text, reprs


def _heard(node: ast.AST, *, described: bool) -> Iterator[ast.AST]:
    """Yield the nodes below `node` that may be read, f-strings whole."""
    for child in ast.iter_child_nodes(node):
        field = isinstance(child, ast.keyword) and child.arg == "description"
        if _is_silent(child) or (field and not described):
            continue
        yield child
        if isinstance(child, ast.JoinedStr):
            for part in child.values:
                if isinstance(part, ast.FormattedValue):
                    yield from _heard(part, described=described)
        else:
            yield from _heard(child, described=described)


def _is_silent(node: ast.AST) -> bool:
    match node:
        case ast.Expr(value=ast.Constant()):
            return True
        case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name)):
            return name in _SILENT_CALLS
        case ast.keyword(arg=name):
            return name in _SILENT_ARGUMENTS
        case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
            return name in _SILENT_NAMES
        case _:
            return False


def _written(node: ast.JoinedStr) -> str:
    """Return an f-string as it is written, with the expressions in braces."""
    parts: list[str] = []
    for part in node.values:
        if isinstance(part, ast.Constant):
            parts.append(str(part.value))
        elif isinstance(part, ast.FormattedValue):
            parts.append("{" + ast.unparse(part.value) + "}")
    return "".join(parts)


def _reprs(node: ast.JoinedStr) -> Iterator[str]:
    values = (part for part in node.values if isinstance(part, ast.FormattedValue))
    return (ast.unparse(part.value) for part in values if part.conversion == ord("r"))


def literal(text: str) -> str:
    """Return the words of a text: without what is put in, commands, code and names of files."""
    for pattern in _NO_WORDS:
        text = pattern.sub(" ", text)
    return text


def table() -> str:
    """Return the table: file, line, text."""
    return "\n".join(
        f"{each.file}:{each.line}\t{' '.join(each.text.split())}" for each in shown_strings()
    )


AMERICAN = (
    "color", "behavior", "center", "gray", "canceled", "canceling", "labeled", "traveled",
    "neighbor", "favor", "honor", "defense", "artifact", "catalog", "modeled", "signaled",
    "analyze", "fulfill",
)  # fmt: skip
"""The screen is British, with -ize as in *unauthorized*; these are not."""
SYNONYMS = {
    "abort": "cancel a mission, halt a plan, stop everything",
    "waypoint": "way",
    "emergency stop": "stop",
    "operating picture": "common operational picture, picture",
}
"""Words of the standards that robots speak, which the screen does not use, and its own."""
IDENTIFIER = re.compile(r"(?<![\w.-])[a-z]+(?:_[a-z0-9]+)+(?!\w)")
FIELDS = frozenset(
    ("at_s", "radius_m", "floor_m", "ceiling_m", "off_by_m", "in_prompts", "occupied_thresh")
)
"""Fields of files that people write, named where one is wrong."""
ROS_NODES = frozenset(("map_server", "bt_navigator"))
"""Nodes of Nav2, by the names that their users know."""
QUOTED = ("pa_console/tui/", "pa_console/session/", "pa_console/views/")
"""Where values are quoted as people quote them."""


@pytest.fixture(scope="module")
def shown() -> list[Shown]:
    """Return every text once for all tests."""
    return shown_strings()


def told(found: Iterator[tuple[Shown, str]]) -> list[str]:
    return [f"{each.file}:{each.line}: {why}: {each.text[:70]}" for each, why in found]


def test_the_table_holds_the_texts_of_the_screen(shown: list[Shown]) -> None:
    texts = {each.text for each in shown}
    assert len(shown) > 2000
    assert "Go to the plan that waits for a decision" in texts
    assert "each mission waits for your approval" in texts
    assert any(each.file == "pa_console/views/event_words.py" for each in shown)


def test_spelling_is_british(shown: list[Shown]) -> None:
    american = re.compile(rf"\b(?:{'|'.join(AMERICAN)})(?:s|ed|ing|ful)?\b", re.IGNORECASE)
    found = ((s, m[0]) for s in shown if (m := american.search(literal(s.text))))
    assert told(found) == []


def test_one_word_means_one_thing(shown: list[Shown]) -> None:
    found = (
        (each, f"{word!r} is {right!r} in the glossary")
        for each in shown
        for word, right in {**SYNONYMS, **retired_words()}.items()
        if uses(literal(each.text), word)
    )
    assert told(found) == []


def test_no_name_from_inside_the_program_is_shown(shown: list[Shown]) -> None:
    known = {*COMMANDS, *FIELDS, *ROS_NODES, *Settings.model_fields}
    found = (
        (each, name)
        for each in shown
        for name in IDENTIFIER.findall(literal(each.text))
        if name not in known
    )
    assert told(found) == []


def test_values_are_not_written_as_python_writes_them(shown: list[Shown]) -> None:
    here = (each for each in shown if each.reprs and each.file.startswith(QUOTED))
    assert told((each, ", ".join(each.reprs)) for each in here) == []


if __name__ == "__main__":
    print(table())
