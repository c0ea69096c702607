"""Code that lies in the folder the user works in is run by no child process."""

import ast
import asyncio
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any, cast

import pytest
from aiohttp import WSMsgType

import pa_console
from pa_console.child_processes import isolated_workers
from pa_console.cli.sessions import web
from pa_console.evaluation.sweep import Workers, cluster
from pa_console.llm.backend import PullError
from pa_console.llm.local.confinement import try_out
from pa_console.llm.local.engine import Engine
from pa_console.llm.models import fetching
from pa_console.llm.models.cache import CACHE_VARIABLE, hash_file, silent
from pa_console.llm.models.catalogue import HubSource, PackageSource
from pa_console.llm.models.preparing import Preparation, prepare
from pa_console.signing import KEY_VARIABLE
from pa_console.tui.terminal import edit_outside, editor_command
from tests.cli.inside import Call
from tests.cli.test_serve_web import served
from tests.llm.asking import answer, tiny_model
from tests.training.adapters.tiny import write_tiny

PACKAGES = ("pip", "pa_console", "multiprocessing", "distributed", "numpy")
MODULES = ("json", "runpy", "re", "sitecustomize", "usercustomize", "huggingface_hub", "llama_cpp")
SOURCE = PackageSource(kind="packages", package="no-such-package", version="1", member="*")
HUB = HubSource(kind="hub", repo="nobody/nothing", file="nothing.gguf", revision="0" * 40)
EDITOR = """\
import json, os, sys
with open(sys.argv[1], "w") as file:
    file.write(os.getcwd())
"""


class Trap:
    """A folder with code of the names that children import; `sprung` lists what was run of it."""

    def __init__(self, folder: Path) -> None:
        self._ran = folder / "ran"
        self._ran.mkdir()
        self.folder = folder / "work"
        self.folder.mkdir()
        for name in PACKAGES:
            package = self.folder / name
            package.mkdir()
            for module in ("__init__", "__main__"):
                self._plant(package / f"{module}.py", name)
        for name in MODULES:
            self._plant(self.folder / f"{name}.py", name)

    def _plant(self, file: Path, name: str) -> None:
        file.write_text(f"open({str(self._ran / name)!r}, 'w').close()\n")

    @property
    def sprung(self) -> list[str]:
        """The names of what was run."""
        return sorted(os.listdir(self._ran))


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Trap:
    """Return a trap in which the user works."""
    set_up = Trap(tmp_path)
    monkeypatch.chdir(set_up.folder)
    return set_up


async def test_the_trap_catches_a_child_that_looks_into_the_working_folder(trap: Trap) -> None:
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "pip", "--version"), stdout=asyncio.subprocess.DEVNULL
    )
    await child.wait()
    assert trap.sprung != []


async def test_the_process_of_the_model_runs_none_of_it(trap: Trap) -> None:
    engine = Engine(tiny_model(Path()))
    finish = (await answer(engine)).finish
    await engine.close()
    assert (finish, trap.sprung) == ("stop", [])


def test_the_trial_of_its_confinement_runs_none_of_it(trap: Trap) -> None:
    assert [item.what for item in try_out()] != ["anything"]
    assert trap.sprung == []


def test_pip_of_a_pull_runs_none_of_it(trap: Trap, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    with pytest.raises(PullError, match=r"[Nn]o matching distribution"):
        fetching.fetch_packages(SOURCE, Path("place"), 1000, silent)
    assert trap.sprung == []


def test_the_hub_s_download_runs_none_of_it(trap: Trap, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    with pytest.raises(PullError):
        fetching.fetch_from_hub(HUB, Path("place"), 1000, silent)
    assert trap.sprung == []


def test_the_preparation_of_weights_runs_none_of_it(
    trap: Trap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "cache")
    monkeypatch.setenv(KEY_VARIABLE, "key.pem")
    source = write_tiny(Path("source.gguf"))
    made = prepare("tiny", Preparation("q8_0"), source, hash_file(source))
    assert made.sha256 == hash_file(made.path)
    assert trap.sprung == []


def test_processes_of_a_pool_run_none_of_it(trap: Trap) -> None:
    with isolated_workers(), ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert pool.submit(os.getpid).result() != os.getpid()
    assert trap.sprung == []


async def test_workers_of_a_sweep_run_none_of_it(trap: Trap) -> None:
    async with cluster(Workers(count=1)) as running:
        await running.wait_for_workers(1)
    assert trap.sprung == []


async def test_the_user_s_editor_is_not_started_where_the_user_works(
    trap: Trap, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = trap.folder / "editor.py"
    script.write_text(EDITOR)
    monkeypatch.setenv("VISUAL", f"{sys.executable} -P {script}")
    left = await edit_outside(cast(Any, _Screen()), editor_command(), "text")
    assert trap.folder not in (Path(left), *Path(left).parents)
    assert trap.sprung == []


class _Screen:
    """A screen whose terminal can be given away."""

    def __init__(self) -> None:
        self.app = self

    def suspend(self) -> "_Screen":
        return self

    batch_update = suspend

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


@pytest.fixture
def web_command(monkeypatch: pytest.MonkeyPatch, call: Call) -> Any:
    """Return what gives the command of a window of `serve --web` with the words given."""

    def command(*words: str) -> list[str]:
        asked: list[Sequence[str]] = []

        def serve_console(command: Sequence[str], _port: int) -> int:
            asked.append(command)
            return 0

        monkeypatch.setattr(web, "serve_console", serve_console)
        assert call(*words).code == 0
        return list(asked[0])

    return command


async def test_a_window_of_the_served_console_runs_none_of_it(trap: Trap, web_command: Any) -> None:
    command = [*web_command("serve", "--web"), "--help"]
    async with served(trap.folder, command) as (browser, tokens):
        assert await browser.login(tokens.make("anna", "operator")) == 303
        window = await browser.open()
        assert (await window.receive()).type in (WSMsgType.CLOSE, WSMsgType.CLOSED)
    assert trap.sprung == []


def test_paths_of_the_command_line_mean_the_same_to_a_window(
    trap: Trap, web_command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("here.yaml", "play.yaml", "weights.gguf"):
        Path(name).write_text("")
    Path("let-in").mkdir()
    monkeypatch.setenv("PA_CONSOLE_RULES", "here.yaml")
    command = web_command(
        *("--set", "world=here.yaml", "serve", "--web", "--scenario", "play.yaml", "--seed", "7"),
        *("--model", "weights.gguf", "--certificates", "let-in", "--witness", "heads"),
    )
    given = dict(pairwise(command))
    here = str(trap.folder)
    assert given["--world"] == f"{here}/here.yaml"
    assert given["--rules"] == f"{here}/here.yaml"
    assert given["--scenario"] == f"{here}/play.yaml"
    assert given["--model"] == f"{here}/weights.gguf"
    assert given["--certificates"] == f"{here}/let-in"
    assert given["--witness"] == f"{here}/heads"
    assert given["--seed"] == "7"
    installed = web_command("serve", "--web", "--world", "checkpoint", "--model", "smollm")
    given = dict(pairwise(installed))
    assert (given["--world"], given["--model"]) == ("checkpoint", "smollm")


def test_the_user_s_own_search_path_means_the_same_to_children(
    trap: Trap, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(("", "own", "/opt/lib")))
    assert call("--version").code == 0
    assert os.environ["PYTHONPATH"] == f"{trap.folder}/own{os.pathsep}/opt/lib"


PRODUCT = Path(pa_console.__file__).parent
ONE_PLACE = PRODUCT / "child_processes.py"
STARTS = {
    *(("subprocess", name) for name in ("run", "Popen", "call", "check_call", "check_output")),
    ("asyncio", "create_subprocess_exec"),
}
POOLS = ("ProcessPoolExecutor", "LocalCluster", "multiprocessing")


@cache
def sources() -> tuple[tuple[str, str, ast.Module], ...]:
    """Return every other module of the product: its name, its text, and it parsed."""
    files = [path for path in PRODUCT.rglob("*.py") if path != ONE_PLACE]
    texts = {str(path.relative_to(PRODUCT)): path.read_text("utf-8") for path in files}
    return tuple((name, text, ast.parse(text)) for name, text in texts.items())


def test_one_place_knows_how_this_python_is_started() -> None:
    found = [
        f"{name}:{node.lineno}"
        for name, _, tree in sources()
        for node in ast.walk(tree)
        if (isinstance(node, ast.Attribute) and node.attr == "executable")
        or (isinstance(node, ast.ImportFrom) and any(a.name == "executable" for a in node.names))
    ]
    assert found == []


def test_every_child_has_a_folder_of_its_own() -> None:
    started, shells, pools = list[str](), list[str](), list[str]()
    for name, source, tree in sources():
        if any(pool in source for pool in POOLS) and "with isolated_workers()" not in source:
            pools.append(name)
        for call in ast.walk(tree):
            if not isinstance(call, ast.Call):
                continue
            module, _, called = ast.unparse(call.func).rpartition(".")
            keywords = {keyword.arg for keyword in call.keywords}
            if (module, called) in STARTS and "cwd" not in keywords:
                started.append(f"{name}:{call.lineno}")
            if called in ("create_subprocess_shell", "system", "popen") or "shell" in keywords:
                shells.append(f"{name}:{call.lineno}")
    assert (started, shells, pools) == ([], [], [])
