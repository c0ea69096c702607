"""Comments, docstrings, pages and build files name no file, folder or module that is gone."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

import pa_console

ROOT = Path(pa_console.__file__).parents[1]
FOLDERS = ("pa_console", "worlds", "rules", "models", "tests", ".github", ".ci")
CODE = ("pa_console", "models/training", "tests", ".ci")
ONLY_IN_THE_WHEEL = "pa_console/data"
ENTRY_POINTS = "pa_console.backends"
HISTORY = "pa_console/manual/changelog.md"
"""Tells of what is gone."""

EXAMPLES = {"drone.py", "robot.py", "checking_robot.py", "lines_link.py", "walker.py", "json.py"}
"""Programs that a reader of the manual has or may write."""

PATH = re.compile(rf"(?<![\w./-])((?:{'|'.join(map(re.escape, FOLDERS))})/[\w./*-]*[\w*])")
MODULE = re.compile(r"(?<![\w./-])((?:pa_console|pa_training|tests)(?:\.\w+)+)")
FILE = re.compile(r"(?<![\w./*{}-])(\w+\.py)\b")


def documents() -> Iterator[Path]:
    """Return every file that people read and that is no program."""
    yield from (ROOT / name for name in ("README.md", "Makefile", "pyproject.toml", ".mkdocs.yml"))
    yield ROOT / ".pre-commit-config.yaml"
    for folder in (".github", "pa_console", "models", "tests"):
        for pattern in ("*.md", "*.yml", "*.cff"):
            yield from (ROOT / folder).rglob(pattern)


def programs() -> Iterator[Path]:
    for folder in CODE:
        yield from (ROOT / folder).rglob("*.py")


def explanations(program: str) -> Iterator[str]:
    """Return the comments of a program, and its strings that are statements."""
    for token in tokenize.generate_tokens(io.StringIO(program).readline):
        if token.type == tokenize.COMMENT:
            yield token.string
    for node in ast.walk(ast.parse(program)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield text
            case _:
                pass


def stands(module: str) -> bool:
    """Return whether `module` is one, or a name that its module or package holds."""
    first, *rest = module.split(".")
    path = ROOT / ("models/training" if first == "pa_training" else "") / first
    for place, part in enumerate(rest):
        inner = path / part
        if inner.is_dir() or inner.with_suffix(".py").is_file():
            path = inner
            continue
        held = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        names = held.read_text(encoding="utf-8") if held.is_file() else ""
        return place > len(rest) - 3 and bool(re.search(rf"\b{part}\b", names))
    return True


def gone(text: str, files: set[str]) -> set[str]:
    """Return what a text names that is not there."""
    paths = {name for name in PATH.findall(text) if not name.startswith(ONLY_IN_THE_WHEEL)}
    modules = {name for name in MODULE.findall(text) if not name.startswith(ENTRY_POINTS)}
    return {
        *(path for path in paths if not (any(ROOT.glob(path)) if "*" in path else exists(path))),
        *(module for module in modules if not stands(module)),
        *(name for name in FILE.findall(text) if name not in files | EXAMPLES),
    }


def exists(path: str) -> bool:
    return (ROOT / path).exists()


@pytest.fixture(scope="module")
def files() -> set[str]:
    """Return the names of all programs."""
    return {path.name for path in programs()}


def test_no_page_and_no_build_file_names_what_is_gone(files: set[str]) -> None:
    stale = {
        str(page.relative_to(ROOT)): found
        for page in documents()
        if page != ROOT / HISTORY and (found := gone(page.read_text(encoding="utf-8"), files))
    }
    assert stale == {}


def test_no_comment_and_no_docstring_names_what_is_gone(files: set[str]) -> None:
    stale: dict[str, set[str]] = {}
    for path in programs():
        program = path.read_text(encoding="utf-8")
        if gone(program, files):  # perhaps in a string that is no explanation: looked at closely
            found = set[str]().union(*(gone(text, files) for text in explanations(program)))
            if found:
                stale[str(path.relative_to(ROOT))] = found
    assert stale == {}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (
            "see pa_console/schema/event_that_is_gone.py",
            {"pa_console/schema/event_that_is_gone.py"},
        ),
        ("see `worlds/*/no_such.yaml`", {"worlds/*/no_such.yaml"}),
        ("run pa_console.schema.gone.Thing", {"pa_console.schema.gone.Thing"}),
        (
            "as pa_console.resources.no_such_function does",
            {"pa_console.resources.no_such_function"},
        ),
        ("as in no_such_program.py", {"no_such_program.py"}),
        ("see tests/conftest.py, pa_console.resources and worlds/*/world.yaml", set[str]()),
    ],
)
def test_what_is_gone_is_found(text: str, found: set[str], files: set[str]) -> None:
    assert gone(text, files) >= found
    assert bool(gone(text, files)) == bool(found)
