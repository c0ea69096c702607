"""What `pip install` brings: the package with its worlds, rules and model catalogue."""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import pa_console
from pa_console import resources
from pa_console.llm.models.catalogue import Catalog

ROOT = Path(pa_console.__file__).parents[1]
MANUAL = "pa_console/manual"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from this checkout."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def wheel(built: Path) -> set[str]:
    """The names of the files in the wheel."""
    return set(zipfile.ZipFile(built).namelist())


def test_the_installed_command_works_far_from_the_checkout(built: Path, tmp_path: Path) -> None:
    place = tmp_path / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(place), str(built)], check=True)
    command = place / "bin" / "pa-console"
    alone = {**os.environ, "PYTHONPATH": str(place), "PYTHONSAFEPATH": "1"}

    def printed(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, command, *words],
            cwd=tmp_path,
            env=alone,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert printed("--version").split() == ["pa-console", pa_console.__version__]
    assert "situation-2" in printed("scenarios", "list")
    assert "32" in printed("rules", "check")


def test_the_default_world_rules_and_catalogue_are_inside(wheel: set[str]) -> None:
    assert wheel >= {
        "pa_console/data/worlds/checkpoint/world.yaml",
        "pa_console/data/worlds/checkpoint/missions/paper.yaml",
        "pa_console/data/rules/checkpoint.yaml",
        "pa_console/data/models/catalog.yaml",
        "pa_console/py.typed",
    }


def test_every_data_file_of_the_checkout_is_inside(wheel: set[str]) -> None:
    for kind in ("worlds", "rules"):
        for path in (ROOT / kind).rglob("*.yaml"):
            assert f"pa_console/data/{path.relative_to(ROOT).as_posix()}" in wheel


def test_the_adapters_of_the_catalogue_are_inside_and_no_other_weights(wheel: set[str]) -> None:
    wanted = {
        f"pa_console/data/models/{adapter.file}"
        for entry in Catalog.load().models
        for adapter in entry.adapters.values()
    }
    assert wanted
    assert {name for name in wheel if name.endswith(".gguf")} == wanted


def test_what_training_needs_and_learnt_stays_in_the_repository(wheel: set[str]) -> None:
    models = {name for name in wheel if name.startswith("pa_console/data/models/")}
    assert {Path(name).suffix for name in models} == {".yaml", ".gguf", ".md", ".tsv"}
    cards = {f"{name.removesuffix('.lora.gguf')}.md" for name in models if name.endswith(".gguf")}
    assert {name for name in models if name.endswith(".md")} == cards
    assert [name for name in models if name.endswith(".yaml")] == [
        "pa_console/data/models/catalog.yaml"
    ]
    assert not [name for name in models if "/language/" in name]


def test_every_module_style_sheet_template_and_picture_is_inside(wheel: set[str]) -> None:
    for path in (ROOT / "pa_console").rglob("*"):
        if path.suffix in (".py", ".tcss", ".jinja", ".css", ".js", ".svg"):
            assert path.relative_to(ROOT).as_posix() in wheel


def test_the_manual_is_inside(wheel: set[str]) -> None:
    pages = {path.relative_to(ROOT).as_posix() for path in (ROOT / MANUAL).glob("*.md")}
    assert pages
    assert {
        name for name in wheel if name.startswith(f"{MANUAL}/") and name.endswith(".md")
    } == pages


def test_nothing_else_is_inside(wheel: set[str]) -> None:
    folders = {name.split("/")[0] for name in wheel}
    assert {folder for folder in folders if not folder.endswith(".dist-info")} == {"pa_console"}


def test_the_command_is_installed(wheel: set[str]) -> None:
    assert any(name.endswith(".dist-info/entry_points.txt") for name in wheel)
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in wheel)


def libraries_imported() -> dict[str, Path]:
    """Every top-level module that the package imports, and a file that does."""
    found: dict[str, Path] = {}
    for path in (ROOT / "pa_console").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found.update({alias.name.split(".")[0]: path for alias in node.names})
            elif isinstance(node, ast.ImportFrom) and node.module:
                found[node.module.split(".")[0]] = path
    own = {*sys.stdlib_module_names, "pa_console"}
    return {name: path for name, path in found.items() if name not in own}


def test_every_library_that_is_imported_is_asked_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    plugins = [extra for extra in extras if extra not in ("test", "dev", "docs", "audit")]
    asked = [*project["dependencies"], *chain.from_iterable(extras[name] for name in plugins)]
    declared = {re.split(r"[^\w.-]", line)[0].lower().replace("_", "-") for line in asked}
    distributions = packages_distributions()
    for module, path in libraries_imported().items():
        names = {name.lower().replace("_", "-") for name in distributions.get(module, [module])}
        assert names & declared, f"{path} imports {module}, which pyproject.toml does not ask for"


def test_every_library_that_is_asked_for_is_pinned_with_hashes_to_a_version_that_will_do() -> None:
    text = (ROOT / ".constraints.txt").read_text(encoding="utf-8")
    pins: dict[str, set[str]] = {}
    for name, version, hashes in re.findall(
        r"^([a-z0-9-]+)==([^ ]+).*((?:\n    --hash=sha256:[0-9a-f]{64}.*)+)", text, re.MULTILINE
    ):
        assert hashes
        pins.setdefault(name, set()).add(version)
    assert sum(map(len, pins.values())) == len(set(re.findall(r"^[a-z0-9].*==[^ ]+", text, re.M)))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    installed = (extras[name] for name in ("test", "dev", "docs"))
    for line in chain(project["dependencies"], *installed):
        asked = Requirement(line)
        name = asked.name.lower().replace("_", "-")
        if name != project["name"]:
            versions = pins.get(name, set())
            assert versions, f"{name} is not in .constraints.txt: run python .ci/pins.py"
            assert all(asked.specifier.contains(version) for version in versions), name


def test_the_version_is_the_same_everywhere() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    cited = (ROOT / ".github" / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {config['version']}\n" in cited


def test_a_commit_is_checked_by_what_make_lint_runs() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = makefile.partition("\nlint:")[2].partition("\n\n")[0]
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    hooks = [hook for repository in config["repos"] for hook in repository["hooks"]]
    entries = {hook["entry"].removeprefix(".venv/bin/") for hook in hooks}
    assert entries == set(re.findall(r"^\t@\$\(BIN\)/(.+)$", recipe, re.MULTILINE))


@pytest.mark.parametrize(
    ("package", "prefix", "hint"),
    [
        ("src/pa_console", "src/.venv", ".venv/bin/pip install --editable '.[mcap]'"),
        ("lib/pa_console", "pipx/venvs/pa-console", "pipx runpip pa-console install "),
        ("lib/pa_console", "venv", "pip install 'pa-console[mcap]'"),
    ],
)
def test_the_command_fits_a_clone_pipx_and_pip(
    package: str, prefix: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "pyproject.toml").touch()
    monkeypatch.setattr(resources, "_PACKAGE", tmp_path / package)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / prefix))
    assert resources.install_hint("mcap").startswith(hint)
