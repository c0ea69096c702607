"""Nothing that the user of this machine has chosen reaches a test; each worker has its cores."""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import count
from pathlib import Path

import pytest
from hypothesis import settings

from pa_console.policy import monitor, rule_checks
from pa_console.settings.schema import describe_settings
from tests.fleets.broker import mosquitto
from tests.quick_textual import quicken

RARELY = 50_000
"""So many more objects are made than freed before the garbage collector looks."""

PLUGIN_TESTS = {
    "aiohttp": ("attacks/test_no_code_of_the_working_folder_runs.py", "cli/test_serve_web.py"),
    "aiomqtt": ("cli/test_site_verb.py",),
    "aiosmtpd": ("observability/test_alert_delivery.py",),
    "distributed": ("evaluation/test_sweep.py",),
    "fastapi": ("cli/test_serve_verb.py", "golden/test_command_line.py", "http"),
    "hatchling": ("test_packaging.py",),
    "httpx2": ("fleets/test_snapshot.py",),
    "importlinter": ("test_layers.py",),
    "jsonschema": (
        "fleets/test_broker_dies.py",
        "fleets/test_contract.py",
        "fleets/test_example_robot.py",
        "fleets/test_what_a_station_believes.py",
    ),
    "matplotlib": ("cli/test_evaluate_verb.py", "evaluation/reporting/test_report.py"),
    "mavsdk": ("fleets/mavlink",),
    "mcap": ("cli/test_export_verb.py",),
    "mcp": ("mcp",),
    "openai": ("llm/servers", "mission/test_model_servers.py"),
    "opentelemetry": ("observability/test_observed_mission.py",),
    "paho": ("fleets/test_broker_loses_messages.py", "fleets/test_client_ids.py"),
    "psutil": ("benchmarks",),
    "pytak": ("cli/test_tak_verb.py", "tak"),
    "vda5050": ("fleets/test_version_two.py",),
}
"""The tests that need a library of an extra, which are left out where it is not installed."""

LACKING = [library for library in PLUGIN_TESTS if find_spec(library) is None]
collect_ignore = [path for library in LACKING for path in PLUGIN_TESTS[library]]

KEPT = ("cache",)
"""The tests' model is looked for where the user keeps models."""


def pytest_configure() -> None:
    """Take a share of the cores, where the suite has several workers, and hear Ctrl-C.

    Models that compute on the same cores wait for each other's threads at every layer. A shell that
    starts the suite behind its back has it ignore Ctrl-C, or with `nohup` a terminal that is gone,
    and so would every command under test.
    What is imported is compiled once, even where the user keeps no compiled modules: the suite
    starts many processes that import the same ones. No property test has a deadline: how long an
    example takes is the machine's business.
    """
    settings.register_profile("suite", deadline=None)
    settings.load_profile("suite")
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if worker.startswith("gw") and hasattr(os, "sched_setaffinity"):
        count = int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        own = sorted(os.sched_getaffinity(0))[int(worker.removeprefix("gw")) :: count]
        os.sched_setaffinity(0, own or os.sched_getaffinity(0))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Start one worker more than there are cores, as many tests wait for timers and processes."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return (cores or 1) + 1


@pytest.fixture(scope="session", autouse=True)
def _quick_textual() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        quicken(patch)
        yield


def pytest_report_header() -> str:
    """Say which broker the tests of the bus run against, and which plugins are not tested."""
    broker = mosquitto() or "the embedded one, as there is no mosquitto"
    without = f"\nno tests of plugins without {', '.join(LACKING)}" if LACKING else ""
    return f"broker: {broker}{without}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long files, so that no worker is left with one at the end."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


def pytest_collection_finish() -> None:
    """Spare the garbage collector the modules and tests, which stay to the end.

    It looks a seventieth as often as Python lets it: beside a console on its screen it would take
    a fifth of the time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(RARELY, 20, 10)


@pytest.fixture(scope="module", autouse=True)
def _collected() -> Iterator[None]:
    """Free what a file of tests leaves, if that is much: consoles hold on to themselves."""
    yield
    if gc.get_count()[1] > 1:
        gc.collect()


@pytest.fixture(scope="session", autouse=True)
def _patient_checks() -> Iterator[None]:
    """Let no stall of the machine, which counts as processor time on some, decide about a plan."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rule_checks, "CHECKS_S", 60.0)
        patch.setattr(monitor, "MOMENT_S", 60.0)
        yield


@pytest.fixture(scope="session")
def _states(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return folders that do not exist yet, one after the other."""
    folder = tmp_path_factory.mktemp("states")
    return (folder / str(number) for number in count())


@pytest.fixture(autouse=True)
def _no_state_of_the_users(_states: Iterator[Path]) -> Iterator[None]:
    """Keep what a console remembers, such as the rules used before, to the test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(next(_states)))
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_settings_of_the_users(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, setting in describe_settings().items():
            if name not in KEPT and setting.variable in os.environ:
                patch.delenv(setting.variable)
        file = tmp_path_factory.mktemp("settings") / "settings.yaml"
        patch.setenv("PA_CONSOLE_SETTINGS", str(file))
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        yield
