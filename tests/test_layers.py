"""The core runs without a screen and without the model library, and imports point one way."""

import json
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import pa_console

ROOT = Path(pa_console.__file__).parents[1]
FRONT = ("pa_console.cli", "pa_console.tui", "pa_console.export", "pa_console.__main__")
"""The front ends, which may import Textual."""

WORKER = (
    *(f"pa_console.llm.local.{name}" for name in ("answer", "decoding", "runtime", "worker")),
    "pa_console.llm.models.gguf_conversion",
)
"""What runs in processes that hold a model; nothing else may import the model libraries."""

APART = (*WORKER, "pa_console.fleets.ros2.node")
"""What else needs libraries that the console does without: rclpy comes with ROS 2."""

PROBE = """
import importlib, json, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


STARTED = "import pa_console.cli.main, sys; print(*sys.modules)"
HELPED = """
import sys
from pa_console.cli.main import app
app(["--help"], standalone_mode=False)
print(*sys.modules)
"""
MISSION_HELPED = HELPED.replace('"--help"', '"mission", "--help"')
CONSOLE_FRAMED = STARTED.replace("main,", "main, pa_console.cli.verbs.console,")
CONSOLE_LOADED = "import pa_console.tui.app, sys; print(*sys.modules)"
VERBS_LOADED = """
import sys
from pa_console.cli.verbs import VERBS, load_verb
for name in VERBS:
    load_verb(name)
print(*sys.modules)
"""


PLAIN = "import sys; print(*sys.modules)"
"""What a process without the console loads."""


def libraries_of_extras() -> set[str]:
    """The modules of the libraries that only an extra brings."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    core = {project["name"], *map(_name, project["dependencies"])}
    plugins = {_name(line) for line in chain.from_iterable(extras)} - core
    owners = packages_distributions().items()
    return {module for module, names in owners if plugins & set(map(canonicalize_name, names))}


def _name(requirement: str) -> str:
    return canonicalize_name(Requirement(requirement).name)


def core_modules() -> list[str]:
    paths = sorted((ROOT / "pa_console").rglob("*.py"))
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]
    modules = [name.removesuffix(".__init__") for name in names]
    return [name for name in modules if not name.startswith(FRONT) and name not in APART]


def imported_by(modules: list[str]) -> set[str]:
    """The top-level packages that a fresh interpreter has after importing `modules`."""
    command = [sys.executable, "-c", PROBE, *modules]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout))


def test_the_core_is_all_there() -> None:
    packages = {name.split(".")[1] for name in core_modules() if "." in name}
    assert packages >= {"schema", "resources", "sim", "policy", "llm", "session", "views"}
    assert packages >= {"mission", "station", "evaluation"}


@pytest.mark.parametrize("script", [STARTED, CONSOLE_LOADED, VERBS_LOADED])
def test_the_console_and_its_verbs_load_no_library_of_an_extra(script: str) -> None:
    libraries = libraries_of_extras()
    assert {"aiomqtt", "matplotlib", "openai", "opentelemetry", "prometheus_client"} <= libraries
    # Setuptools, which a test's server needs, puts a part of itself into every process.
    assert not (loaded_by(script) - loaded_by(PLAIN)) & libraries


def test_the_core_needs_neither_a_screen_nor_the_model_libraries() -> None:
    imported = imported_by(core_modules())
    assert "pa_console" in imported
    assert not imported & {"textual", "llama_cpp", "llguidance", "openai", "jsonschema"}


def test_only_the_worker_needs_the_model_libraries() -> None:
    assert imported_by(list(WORKER)) >= {"llama_cpp", "llguidance"}


def printed_by(script: str) -> str:
    """What a fresh interpreter prints with `script`, whose last line is all modules that it has."""
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def loaded_by(script: str) -> set[str]:
    """The words that `script` prints, all modules among them."""
    return set(printed_by(script).split())


def test_the_command_line_starts_without_what_its_verbs_need() -> None:
    started = loaded_by(STARTED)
    assert "pa_console.cli.verbs" in started
    assert not started & {"pydantic", "numpy", "shapely", "pa_console.evaluation", "textual"}


def test_the_help_tells_of_every_verb_and_loads_none() -> None:
    helped = loaded_by(HELPED)
    assert {"console", "mission", "manual", "pa_console.cli.verbs"} <= helped
    assert not helped & {
        "numpy",
        "shapely",
        "cel",
        "pa_console.cli.verbs.mission",
        "pa_console.schema.world",
    }


def test_the_help_of_a_mission_waits_for_no_session() -> None:
    helped = loaded_by(MISSION_HELPED)
    assert "pa_console.cli.verbs.mission" in helped
    assert not helped & {"numpy", "shapely", "cel", "pa_console.station", "pa_console.llm"}


def test_the_console_opens_without_what_only_other_screens_need() -> None:
    loaded = loaded_by(CONSOLE_LOADED)
    assert "pa_console.tui.screens.main" in loaded
    assert not loaded & {
        "pa_console.mcp",
        "prompt_toolkit",
        "pa_console.evaluation.reporting.report",
        "pa_console.tui.screens.compare",
        "pa_console.tui.screens.evaluation",
        "pa_console.tui.screens.policies",
    }


def test_the_frame_of_a_console_waits_for_neither_the_screen_nor_a_session() -> None:
    framed = loaded_by(CONSOLE_FRAMED)
    assert "pa_console.terminal.opening_frame" in framed
    assert not framed & {"textual", "numpy", "cel", "cryptography", "pa_console.llm"}
    assert not framed & {"pa_console.station", "pa_console.schema.world", "pydantic_settings"}


@pytest.mark.parametrize(
    ("script", "most"),
    [
        (STARTED, 280),
        (HELPED, 285),
        (MISSION_HELPED, 385),
        (CONSOLE_FRAMED, 420),
        (CONSOLE_LOADED, 1090),
    ],
)
def test_an_entry_point_keeps_to_its_number_of_modules(script: str, most: int) -> None:
    assert len(printed_by(script).splitlines()[-1].split()) <= most


def test_every_verb_is_there_without_what_trains_and_without_a_screen() -> None:
    loaded = loaded_by(VERBS_LOADED)
    assert {"pa_console.cli.verbs.evaluate", "pa_console.evaluation"} <= loaded
    assert not loaded & {"pa_training", "torch", "gguf", "textual", "llama_cpp"}
    assert not loaded & {"openai", "httpx2", "jsonschema"}, "no server is named"
    assert not loaded & {"distributed", "dask"}, "nobody sweeps"


def test_the_probe_would_see_a_screen() -> None:
    assert "textual" in imported_by(["textual"])


def test_the_import_contracts_hold(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "path", sys.path.copy())
    lint_imports = import_module("importlinter.cli").lint_imports
    failed = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert not failed, capsys.readouterr().out
