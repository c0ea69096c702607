"""`pa-console doctor`: what is missing is named with its remedy, and decides the exit code."""

import asyncio
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from pa_console.cli.verbs import doctor
from pa_console.cli.verbs.doctor import checks as doctor_checks
from pa_console.cli.verbs.doctor import models
from pa_console.cli.verbs.doctor.checks import (
    Check,
    check_broker,
    check_build_tools,
    check_colours,
    check_folder,
    check_link,
    check_schemes,
    check_size,
    check_unicode,
    load_or_default,
)
from pa_console.cli.verbs.doctor.models import (
    check_memory,
    check_model,
    check_server,
    check_servers,
    check_speed,
    named_models,
    speed_words,
)
from pa_console.fleets import link
from pa_console.fleets.link import GROUP, LinkNotice
from pa_console.llm.backend import EngineDiedError, EngineError
from pa_console.llm.models.catalogue import Catalog, LocalModel
from pa_console.llm.models.preparing import prepared_path
from pa_console.llm.remote.address import KEY_VARIABLE
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.terminal.mission import step_line
from tests.cli.inside import Call
from tests.fleets.scripted_link import Desk, ScriptedLink
from tests.llm.servers.fault_proxy import FaultProxy
from tests.scripted import ScriptedEngine, plan

MODEL = "smollm2-135m"
PATH = "/home/ann/" + "a-long-folder/" * 12 + "file.gguf"


def test_everything_is_looked_at(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PA_CONSOLE_MODEL", MODEL)
    monkeypatch.setattr(models, "LIMIT_S", 2.0)
    done = call("doctor", "--json")
    checks = {check["name"]: check for check in done.json["checks"]}
    assert checks.keys() >= {
        "Python", "C++ compiler", "CMake", "textual", "llama-cpp-python", "settings", "model",
        "memory, cores", "model's speed", "config folder", "log folder", "cache folder", "terminal",
    }  # fmt: skip
    assert checks["textual"]["state"] == "ok"
    assert "not measured" not in checks["model's speed"]["found"]
    assert (done.code == 0) == (not any(c["state"] == "missing" for c in checks.values()))


def open_scripted(address: str, world: World, settings: Settings) -> ScriptedLink:
    if address == "off":
        raise ValueError("nothing answers there: switch it on")
    link = ScriptedLink(f"own:{address}", {"Drone_T01"})
    if address == "cut":
        link.problem = "no carrier"
    link.news.append(LinkNotice("info", link.name, "speaks version 3"))
    link.news.append(Desk(world).report("Drone_T01", "Base"))
    return link


@pytest.mark.parametrize(
    ("address", "state", "found"),
    [
        ("on", "ok", "own:on: connected; reports from Drone_T01; speaks version 3"),
        ("cut", "missing", "no connection: no carrier"),
        ("off", "missing", "nothing answers there: switch it on"),
    ],
)
def test_a_link_is_looked_at(
    address: str, state: str, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    point = EntryPoint("own", f"{__name__}:open_scripted", GROUP)
    monkeypatch.setattr(link, "link_schemes", lambda: {"own": point})
    check = check_link(f"own:{address}", Settings())
    assert check.state == state
    assert found in check.found


def test_kinds_of_links_are_listed_and_a_broken_one_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = {
        name: EntryPoint(name, value, GROUP)
        for name, value in (
            ("own", f"{__name__}:open_scripted"),
            ("broken", f"{__name__}:no_such_function"),
            ("mavlink", "no_such_library:open_link"),
        )
    }
    monkeypatch.setattr(doctor_checks, "link_schemes", lambda: points)
    monkeypatch.setattr(doctor_checks, "OWN", (points["mavlink"],))
    checks = {check.name: check for check in check_schemes()}
    assert [check.state for check in checks.values()] == ["ok", "ok", "warning", "ok"]
    assert "no_such_function" in checks["link broken"].found
    assert "[mavlink]'" in checks["link mavlink"].found


@pytest.mark.parametrize(("state", "code"), [("ok", 0), ("warning", 0), ("missing", 1)])
def test_only_what_is_missing_fails(
    call: Call, monkeypatch: pytest.MonkeyPatch, state: doctor_checks.State, code: int
) -> None:
    found = Check("thing", state, PATH, "mend it")

    def checks(_: Callable[[str], None]) -> Iterator[Check]:
        return iter([found])

    monkeypatch.setattr(doctor, "_checks", checks)
    done = call("doctor")
    assert done.code == code
    assert f"thing: {state}: {PATH} → mend it" in done.said
    assert PATH in done.out, "no path is broken in a pipe"
    assert call("doctor", "--json").json["ok"] == (code == 0)


def test_a_compiler_is_only_missed_while_llama_cpp_is_not_built(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nowhere(name: str) -> None:
        return None

    monkeypatch.setattr(doctor_checks.shutil, "which", nowhere)
    assert {check.state for check in check_build_tools()} == {"ok"}

    def broken(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(doctor_checks.importlib, "import_module", broken)
    assert {check.state for check in check_build_tools()} == {"missing"}
    lost = next(check for check in doctor_checks.check_libraries() if check.name == "textual")
    assert lost.state == "missing"
    assert "pip install" in lost.remedy


def test_a_model_that_is_not_here_or_not_the_pinned_one_is_told_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PA_CONSOLE_CACHE", str(tmp_path))
    absent, _ = check_model(MODEL)
    assert (absent.state, absent.remedy) == ("missing", f"pa-console models pull {MODEL}")
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / f"{MODEL}.gguf").write_bytes(b"cut short")
    wrong, _ = check_model(MODEL)
    assert wrong.state == "missing"
    assert "SHA-256" in wrong.found
    model = Catalog.load().get(MODEL)
    assert model.how is not None
    prepared_path(model.stem, model.how).write_bytes(b"0" * 2_000_000)
    _, memory = check_model(MODEL)
    assert "502 MB needed" in memory.found
    (unknown,) = check_model("gpt-9")
    assert unknown.state == "missing"


def test_settings_that_cannot_be_used_are_told_and_the_rest_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "settings.yaml"
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", str(file))
    file.write_text("speed: 99\n")
    loaded, check = load_or_default()
    assert (loaded.values.speed, check.state) == (1.0, "missing")
    assert f"{file}:1" in check.found
    file.write_text("theme: nrod\n")
    assert load_or_default()[1].state == "missing"
    file.write_text("theme: nord\n")
    monkeypatch.setenv("PA_CONSOLE_MODLE", "x")
    assert load_or_default()[1].state == "warning"


def test_folders_memory_and_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    assert check_folder("logs", tmp_path / "a" / "b", "x").state == "ok"
    assert check_folder("logs", tmp_path / "file" / "b", "x").state == "missing"
    monkeypatch.setattr(doctor_checks, "LEAST_FREE_MB", 10**12)
    assert check_folder("logs", tmp_path, "x").state == "warning"
    memory = tmp_path / "meminfo"
    memory.write_text("MemTotal: 9 kB\nMemAvailable: 1000000 kB\n")
    assert check_memory(600, memory).state == "warning"
    assert "1024 MB free" in check_memory(600, memory).found
    assert "is unknown on this system" in check_memory(500, tmp_path / "none").found
    assert [check_size(*size).state for size in ((80, 24), (79, 24), (59, 17))] == [
        "ok", "warning", "missing",
    ]  # fmt: skip
    assert [check_colours(name, False).state for name in ("truecolor", "256", "standard")] == [
        "ok", "ok", "warning",
    ]  # fmt: skip
    assert check_colours(None, True).state == "ok"
    assert (check_unicode("UTF-8").state, check_unicode("ascii").state) == ("ok", "missing")


@pytest.mark.parametrize(
    ("seconds", "state", "words"), [(2.0, "ok", "fast enough"), (7.5, "warning", "slow")]
)
def test_the_model_s_speed_is_reported_with_whether_it_is_enough(
    seconds: float, state: doctor_checks.State, words: str
) -> None:
    usage = Usage(
        prompt_tokens=300, cached_tokens=100, completion_tokens=50,
        first_token_s=seconds - 1.0, seconds=seconds,
    )  # fmt: skip
    check = speed_words("pa-135m", usage)
    assert check.state == state
    assert f"{200 / (seconds - 1.0):.0f} and writes 50 tokens/s" in check.found
    assert words in check.found
    assert bool(check.remedy) == (state == "warning")


def test_the_speed_of_a_model_that_is_not_here_is_not_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PA_CONSOLE_CACHE", str(tmp_path))
    check = check_speed(MODEL)
    assert check.state == "ok"
    assert check.found.startswith("not measured")
    assert f"pa-console models pull {MODEL}" in check.found


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "did not write a plan within 0.05 s"),
        (EngineDiedError("the model's process died"), "the model's process died"),
        (plan(("Drone_T04", "observe EastGate")), "a plan takes"),
    ],
)
def test_a_model_that_does_not_answer_in_time_or_fails_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, answer: str | EngineError | None, words: str
) -> None:
    scripted = ScriptedEngine([answer])

    def find_model(_: str | None) -> LocalModel:
        return scripted.model

    def engine(_: LocalModel) -> ScriptedEngine:
        return scripted

    monkeypatch.setattr(models, "find_model", find_model)
    monkeypatch.setattr(models, "Engine", engine)
    if answer is None:
        monkeypatch.setattr(models, "LIMIT_S", 0.05)
    check = check_speed("")
    assert words in check.found
    assert check.state == ("ok" if isinstance(answer, str) else "warning")


def test_a_broker_of_an_older_version_that_lets_client_ids_be_taken_is_named(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    def no_others(_tell: Callable[[str], None]) -> Iterator[Check]:
        return iter(())

    monkeypatch.setattr(doctor, "_checks", no_others)
    assert call("site", "init", str(tmp_path)).code == 0
    assert check_broker(tmp_path).state == "ok"
    file = tmp_path / "mosquitto.conf"
    older = file.read_text().replace("use_username_as_clientid true\n", "")
    for text in (older, f"# use_username_as_clientid true\n{older}"):
        file.write_text(text)
        found = check_broker(tmp_path)
        assert found.state == "missing"
        assert "use_username_as_clientid true" in found.found
        assert f"pa-console site init {tmp_path}" in found.remedy
    looked = call("doctor", "--certificates", str(tmp_path), "--json")
    assert [(each["name"], each["state"]) for each in looked.json["checks"]] == [
        ("broker", "missing")
    ]
    assert looked.code == 1
    assert call("site", "init", str(tmp_path)).code == 0
    assert check_broker(tmp_path).state == "ok"
    assert check_broker(tmp_path / "elsewhere").state == "warning"


CANARY = "sk-canary-4711"


async def looked(proxy: FaultProxy) -> Check:
    async with proxy.running():
        return await asyncio.to_thread(check_server, "planner", proxy.address)


async def test_what_holds_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("openai", reason="model servers need the extra `openai`")
    monkeypatch.setenv(KEY_VARIABLE, CANARY)
    check = await looked(FaultProxy(holds=("guided_json",)))
    assert check.state == "ok"
    assert "guided_json works" in check.found
    assert f"key from {KEY_VARIABLE}" in check.found
    assert CANARY not in repr(check)


async def test_that_nothing_holds_is_a_warning() -> None:
    pytest.importorskip("openai", reason="model servers need the extra `openai`")
    check = await looked(FaultProxy(holds=()))
    assert check.state == "warning"
    assert "answers cannot be constrained" in check.found


async def test_a_server_that_is_away_is_a_warning() -> None:
    pytest.importorskip("openai", reason="model servers need the extra `openai`")
    proxy = FaultProxy()
    proxy.faults = ["401"]
    check = await looked(proxy)
    assert (check.state, "answered 401" in check.found) == ("warning", True)
    assert KEY_VARIABLE in check.remedy


def test_a_server_elsewhere_without_https_is_not_asked() -> None:
    pytest.importorskip("openai", reason="model servers need the extra `openai`")
    check = check_server("planner", "openai:http://10.0.0.5/v1#m")
    assert check.state == "missing"
    assert "plain_servers" in check.found


def test_nobody_is_asked_where_no_server_is_named() -> None:
    assert list(check_servers(named_models(Settings()), Settings())) == []


def test_a_judge_that_is_no_server_is_told() -> None:
    settings = Settings(judge_server="pa-500m")
    (check,) = check_servers(named_models(settings), settings)
    assert check.state == "missing"


def test_whoever_follows_a_mission_is_told_who_answers() -> None:
    changed = ev.ServerChanged(
        server="openai:http://127.0.0.1/v1#m", serves=("planner",), state="away", detail="is gone"
    )
    took_over = ev.Noticed(level="warning", subject="model server", text="the own model answers")
    lines = [
        step_line(ev.Event(t=datetime.now(UTC), tick=0, data=data)) for data in (changed, took_over)
    ]
    assert lines[0] == "model server: openai:http://127.0.0.1/v1#m away: is gone"
    assert lines[1] == "model server: the own model answers"
