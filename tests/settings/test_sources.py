"""Where a setting's value comes from, and how a wrong one is explained."""

import re
from pathlib import Path

import pytest

import pa_console
from pa_console.schema.document import DocumentError
from pa_console.settings.schema import Settings, describe_settings
from pa_console.settings.sources import (
    FILE_VARIABLE,
    SECRET_VARIABLES,
    load_settings,
    settings_file,
    unknown_variables,
)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's settings file, which is not there yet."""
    path = tmp_path / "settings.yaml"
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", str(path))
    return path


def test_the_first_source_that_has_a_value_wins_and_is_named(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_text("# mine\ntheme: nord\nspeed: 2\nmouse: off\n")
    monkeypatch.setenv("PA_CONSOLE_SPEED", "4")
    monkeypatch.setenv("PA_CONSOLE_THEME", "dracula")
    loaded = load_settings({"theme": "gruvbox"})
    assert (loaded.values.theme, loaded.values.speed) == ("gruvbox", 4.0)
    assert (loaded.values.mouse, loaded.values.world) == (False, "checkpoint")
    told = {
        name: (loaded.origin(name).source, loaded.origin(name).place)
        for name in ("theme", "speed", "mouse", "world")
    }
    assert told == {
        "theme": ("command line", "--set theme"),
        "speed": ("environment", "PA_CONSOLE_SPEED"),
        "mouse": ("file", f"{file}:4"),
        "world": ("default", ""),
    }


def test_without_a_file_the_defaults_are_in_force(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PA_CONSOLE_CACHE", raising=False)
    assert load_settings().values == Settings()
    file.write_text("# nothing yet\n")
    assert load_settings().values == Settings()


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("theme: nord\nspeed: 9", 2, r"speed: .*from 1 to 8.*default \(1\)"),
        ("approval_delay_s: soon", 1, "approval_delay_s: .*number"),
        ("\nthemes: nord", 2, "did you mean theme"),
        ("keys:\n  stop: 12", 2, "keys.stop"),
        ("keys: f11", 1, "keys: expected names.*`keys: {stop: f11}` in the file"),
        ("- theme", 1, "theme: pa-console-light"),
        ("theme: [", 1, "not valid YAML"),
        ("logs: here", 1, "absolute path"),
    ],
)
def test_a_wrong_file_is_explained_with_its_line(
    file: Path, text: str, line: int, says: str
) -> None:
    file.write_text(text)
    with pytest.raises(DocumentError, match=says) as raised:
        load_settings()
    assert raised.value.source == str(file)
    assert raised.value.line == line


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("PA_CONSOLE_SPEED", "fast", "PA_CONSOLE_SPEED: .*from 1 to 8"),
        ("PA_CONSOLE_KEYS", "stop=f11", "PA_CONSOLE_KEYS: not JSON"),
        ("PA_CONSOLE_KEYS", '["f11"]', """give .*PA_CONSOLE_KEYS='{"stop": "f11"}'"""),
    ],
)
@pytest.mark.usefixtures("file")
def test_a_wrong_variable_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, says: str
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(DocumentError, match=says):
        load_settings()


def test_every_field_has_a_title_a_help_and_a_variable_that_sets_it(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = {"speed": "3", "approval_delay_s": "1.5", "stale_after_s": "9", "history_kept": "7",
               "standing_confidence": "0.5", "check_deadline_ms": "20",
               "moment_grace_s": "30", "shortest_interval_s": "30",
               "patrol_stay_s": "5", "patrol_laps": "3",
               "server_patience_s": "10", "plain_servers": "off", "require_sandbox": "on",
               "live_reading": "off",
               "alarms": "off", "mouse": "0", "bell": "off", "desktop_notices": "off",
               "window_title": "off", "trace_words": "on", "metrics_port": "9464",
               "traces": "http://127.0.0.1:4318", "tak": "tls://127.0.0.1:8089",
               "tak_contacts": "off", "alert_from": "low", "alert_after_min": "9",
               "keys": '{"stop": "f11"}'}  # fmt: skip
    for name, about in describe_settings().items():
        assert about.title
        assert about.help.endswith(".")
        monkeypatch.setenv(about.variable, samples.get(name, str(file.parent / name)))
    loaded = load_settings()
    assert all(loaded.origin(name).source == "environment" for name in describe_settings())
    assert loaded.values.keys == {"stop": "f11"}


@pytest.mark.usefixtures("file")
def test_a_folder_in_a_variable_is_seen_from_here_and_an_empty_one_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PA_CONSOLE_CACHE", "models-here")
    assert load_settings().values.cache == Path.cwd() / "models-here"
    monkeypatch.setenv("PA_CONSOLE_CACHE", "")
    assert load_settings().values.cache is None


def test_a_cache_chosen_in_the_file_is_where_models_are_looked_for(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pa_console.llm.models.cache import models_folder  # noqa: PLC0415

    monkeypatch.setenv("PA_CONSOLE_CACHE", "")
    file.write_text(f"cache: {file.parent / 'big disk'}\n")
    loaded = load_settings()
    loaded.export()
    assert models_folder() == file.parent / "big disk" / "models"
    assert loaded.again().origin("cache").source == "file"


def test_a_variable_that_nothing_reads_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PA_CONSOLE_MODLE", "x")
    assert unknown_variables() == ["PA_CONSOLE_MODLE"]


def test_the_file_is_in_the_platforms_config_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PA_CONSOLE_SETTINGS")
    monkeypatch.setenv("XDG_CONFIG_HOME", "/somewhere")
    assert settings_file().parent.name == "pa-console"


def test_every_variable_that_the_program_reads_is_known_and_in_the_manual() -> None:
    package = Path(pa_console.__file__).parent
    page = (package / "manual" / "settings.md").read_text(encoding="utf-8")
    settings = {setting.variable for setting in describe_settings().values()}
    named = {
        name
        for file in package.rglob("*.py")
        for name in re.findall(r"PA_CONSOLE_[A-Z_]*[A-Z]", file.read_text(encoding="utf-8"))
    }
    assert named
    for name in (named | {FILE_VARIABLE, *SECRET_VARIABLES}) - settings:
        assert f"`{name}`" in page, name
        assert name in {FILE_VARIABLE, *SECRET_VARIABLES}
