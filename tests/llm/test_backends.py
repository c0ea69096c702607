"""A package outside brings its own backend by an entry point; the console's own comes first."""

from collections.abc import AsyncGenerator, Callable, Iterator
from importlib.metadata import EntryPoint
from typing import Any
from unittest.mock import Mock

import pytest

from pa_console.llm import backend
from pa_console.llm.backend import BackendOptions, GenerationEnd, ModelError, Request, names_backend
from pa_console.llm.models.catalogue import Catalog, ServerEntry
from pa_console.llm.remote.engine import ServerEngine
from pa_console.llm.remote.servers import Servers, session_models
from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from tests.scripted import SUCCESS, ScriptedEngine, plan

NAME = "oracle:of the hill"
PLAN = plan(("Drone_T04", "move_to NorthGate"))


class Oracle:
    """A backend of a package outside: it always gives the same plan."""

    def __init__(self, name: str, options: BackendOptions) -> None:
        self.name, self.options, self.usable = name, options, True
        self.on_state: Callable[[Any, str], None] | None = None
        self.closed = False

    async def start(self) -> None:
        """Report to be ready."""
        if self.on_state is not None:
            self.on_state("ready", "it knows already")

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Give the plan."""
        yield PLAN
        yield GenerationEnd(PLAN, Usage(), "stop")

    async def close(self) -> None:
        """Note that it was closed."""
        self.closed = True


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    """Install packages with the schemes `oracle`, `broken` and, not heeded, `openai`."""
    points = [
        EntryPoint("oracle", f"{__name__}:Oracle", backend.GROUP),
        EntryPoint("broken", f"{__name__}:Missing", backend.GROUP),
        EntryPoint("openai", f"{__name__}:Oracle", backend.GROUP),
    ]
    monkeypatch.setattr(backend, "entry_points", Mock(return_value=points))
    backend.backend_schemes.cache_clear()
    yield
    backend.backend_schemes.cache_clear()


async def test_a_backend_of_another_package_plans_a_mission() -> None:
    chosen = session_models(NAME, "", "")
    assert (chosen.own, chosen.named) == (None, {"planner": NAME})
    servers = Servers.open(chosen.named, patience_s=7.0)
    oracle = servers.by_use["planner"]
    assert isinstance(oracle, Oracle)
    assert oracle.options == BackendOptions("planner", plain=False, patience_s=7.0)
    station = open_station(
        load_site("checkpoint", "checkpoint", deadline_s=60.0),
        ScriptedEngine([None], [SUCCESS]).engine(),
        SteppedClock(),
        servers=servers,
    )
    events: list[ev.Event] = []
    (trace,) = await run_missions(
        station,
        ["Drone_T04, fly to NorthGate."],
        standing_approver("auto"),
        lambda event, _state: events.append(event),
    )
    assert trace.status == "verified"
    (changed,) = [e.data for e in events if isinstance(e.data, ev.ServerChanged)]
    assert (changed.server, changed.serves, changed.state) == (NAME, ("planner",), "ready")
    assert {e.data.server for e in events if isinstance(e.data, ev.PromptBuilt)} == {NAME, ""}
    assert oracle.closed


def test_no_package_takes_the_place_of_the_console_s_own_scheme() -> None:
    opened = Servers.open({"planner": "openai:http://127.0.0.1:8080/v1#m"}).by_use["planner"]
    assert isinstance(opened, ServerEngine)


def test_a_backend_that_cannot_be_loaded_is_named_with_the_reason() -> None:
    with pytest.raises(ModelError, match=r"broken:x: the backend .*:Missing cannot be loaded"):
        Servers.open({"planner": "broken:x"})


def test_a_catalogue_entry_may_name_any_scheme_that_is_installed() -> None:
    assert ServerEntry(name="hill", title="Hill", address=NAME).address == NAME
    with pytest.raises(ValueError, match="openai:BASE_URL#NAME"):
        ServerEntry(name="hill", title="Hill", address="sibyl:x")
    with pytest.raises(ModelError, match="on a server"):
        Catalog.load().get(NAME)


@pytest.mark.parametrize(
    "name", [None, "", "smollm2-135m", "C:/models/m.gguf", "sibyl:x", "oracle"]
)
def test_any_other_name_is_that_of_a_model_of_this_machine(name: str | None) -> None:
    assert not names_backend(name)
