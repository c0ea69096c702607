"""What README and manual show can be done as it stands there, and what they name exists."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from pa_console.cli.verbs import VERBS
from pa_console.evaluation.jobs import load_with_worlds
from pa_console.manual_pages import read_page
from pa_console.sim.worlds.world_file import load_world
from tests.cli.conftest import Call
from tests.cli.parsing import left_over

ROOT = Path(__file__).parents[2]
MANUAL = ROOT / "pa_console" / "manual"
README = ROOT / "README.md"
MANUAL_PAGES = sorted(MANUAL.glob("*.md"))
PAGES = [README, *MANUAL_PAGES, ROOT / "models" / "experiments.md"]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TOP = ("pa_console/", "worlds/", "rules/", "models/", "tests/")
"""Where a path has to begin to be one of the repository's and not an example."""


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose(page: Path) -> str:
    """Return a page without its code blocks."""
    return FENCE.sub("", text_of(page))


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in FENCE.findall(text_of(page)) if kind == language]


def shell_lines(page: Path) -> Iterator[str]:
    """Yield every line of the code blocks that a shell runs, continued lines joined."""
    for text in blocks(page, ""):
        yield from filter(None, text.replace("\\\n", " ").splitlines())


def each_page(pages: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("page", pages, ids=lambda page: page.name)


COMMANDS = [
    pytest.param(line, id=f"{page.name}: {line[:60]}")
    for page in PAGES
    for line in shell_lines(page)
    if line.startswith("pa-console")
]
SAMPLES = {
    yaml.safe_load(text)["name"]: text
    for page in PAGES
    for text in blocks(page, "yaml")
    if text.startswith("name: ")
}


@pytest.fixture
def sample(tmp_path: Path) -> Callable[[str], Path]:
    def write(name: str) -> Path:
        path = tmp_path / f"{name}.yaml"
        path.write_text(SAMPLES[name], encoding="utf-8")
        return path

    return write


def test_the_sample_scenario_is_valid(call: Call, sample: Callable[[str], Path]) -> None:
    assert call("scenarios", "check", str(sample("night-visit"))).code == 0


def test_the_sample_rules_are_right_and_not_doubtful(
    call: Call, sample: Callable[[str], Path]
) -> None:
    rules = str(sample("house"))
    assert "0 wrong" in call("rules", "check", rules).out
    linted = call("rules", "lint", rules)
    assert linted.code == 0
    assert "errors 0, warnings 0" in linted.out


def test_the_sample_missions_can_be_loaded(sample: Callable[[str], Path]) -> None:
    world = load_world(ROOT / "worlds" / "checkpoint" / "world.yaml")
    missions, worlds = load_with_worlds(sample("mine"), world)
    assert [case.id for case in missions.missions] == ["A1"]
    assert "yard" in worlds


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_is_one_that_a_verb_takes(line: str) -> None:
    assert not left_over(line)


@each_page(PAGES)
def test_every_other_command_names_what_is_there(page: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in shell_lines(page):
        words = line.split("#")[0].split()
        if words[0] == "make":
            assert re.search(rf"^(?:[\w ]+ )?{words[1]}(?: [\w ]+)?:", makefile, re.MULTILINE), line
        elif "python -m" in line:
            variables, module = words[: words.index("python")], words[words.index("-m") + 1]
            folders = [variable.partition("=")[2] for variable in variables] or [""]
            found = [ROOT / folder / f"{module.replace('.', '/')}.py" for folder in folders]
            assert any(path.is_file() for path in found), line
        else:
            assert "pa-console" in line or words[-3:] == ["pip", "install", "."], line


@each_page(PAGES)
def test_every_program_is_python(page: Path) -> None:
    for program in blocks(page, "python"):
        ast.parse(program)


@each_page(PAGES)
def test_every_file_that_is_named_exists(page: Path) -> None:
    named = re.findall(r"`([\w.*/-]+\.[a-z]+)`", prose(page))
    missing = [name for name in named if name.startswith(TOP) and not (ROOT / name).is_file()]
    assert not missing


@each_page(PAGES)
def test_every_link_leads_to_a_page(page: Path) -> None:
    for target in re.findall(r"\]\(([^)]+)\)", prose(page)):
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve()
        assert file.is_file(), target
        assert not anchor or read_page(file.stem, text_of(file)).heading_of(anchor), target
        if page in MANUAL_PAGES:
            assert file.parent == MANUAL, f"{target}: the manual is shown without the repository"


@each_page(MANUAL_PAGES)
def test_a_page_begins_with_its_title_and_what_it_is_for(page: Path) -> None:
    title, empty, *rest = text_of(page).split("\n")
    purpose = " ".join(rest[: rest.index("")])
    assert re.fullmatch(r"# \S.*", title)
    assert not empty
    assert re.fullmatch(r"\w.*[.:]", purpose)


def test_the_index_leads_to_every_page() -> None:
    index = MANUAL / "index.md"
    linked = set(re.findall(r"\]\((\w[\w-]*\.md)\)", text_of(index)))
    assert linked == {page.name for page in MANUAL_PAGES} - {index.name}


def test_the_readme_is_a_front_page() -> None:
    text = text_of(README)
    assert len(text.splitlines()) <= 130
    assert len(text.split()) <= 1100
    assert "![" in "\n".join(text.splitlines()[:20])


def test_the_manual_names_every_verb() -> None:
    table = text_of(MANUAL / "command-line.md").partition("## Verbs")[2].partition("\n## ")[0]
    assert set(VERBS) <= set(re.findall(r"`(\w+)", table))


def test_the_manual_names_every_package_and_no_other() -> None:
    text = text_of(MANUAL / "architecture.md")
    table = text.partition("## The packages")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]*) \|", table, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    package = ROOT / "pa_console"
    folders = {init.parent.name for init in package.glob("*/__init__.py")}
    assert named == folders | {package.name, MANUAL.name}


@pytest.mark.parametrize(("verb", "page"), [("models", "models.md"), ("scenarios", "worlds.md")])
def test_a_page_lists_what_the_verb_lists(call: Call, verb: str, page: str) -> None:
    text = text_of(MANUAL / page)
    listed = call(verb, "list", "--json").json
    assert [entry["name"] for entry in listed if f"`{entry['name']}`" not in text] == []


def test_the_manual_explains_every_setting(call: Call) -> None:
    text = text_of(MANUAL / "settings.md")
    listed = call("settings", "show", "--json").json["settings"]
    assert [entry["name"] for entry in listed if f"`{entry['name']}`" not in text] == []
