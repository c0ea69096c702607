"""One session that is served, with a scripted model, for all tests of a file."""

import asyncio
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import httpx
import pytest

import pa_console as pa
from pa_console.fleets.authorization import Role
from pa_console.http import http_app
from pa_console.signing import KEY_VARIABLE
from tests.scripted import ScriptedEngine, plan

WRITES_AT_ONCE = 40
ASKS_AT_ONCE = 250
FILL = plan(("Drone_T04", "move_to EastGate"))
PEOPLE: dict[str, Role] = {
    "olaf": "observer",
    "anna": "operator",
    "carl": "commander",
    "bert": "operator",
}


class Site:
    """A served session in a thread of its own; `ask` sends requests with the token of a role."""

    def __init__(self, folder: Path) -> None:
        self.log = folder / "session.jsonl"
        self.engine = ScriptedEngine([FILL])
        self.address = ""
        self.tokens: dict[str, str] = {}
        self._client = httpx.Client(timeout=300)
        self._begun: Future[None] = Future()
        self._end: Callable[[], object] = lambda: None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def start(self) -> None:
        """Return as soon as it is served."""
        self._thread.start()
        self._begun.result(timeout=300)

    def close(self) -> None:
        """End the session."""
        self._client.close()
        self._end()
        self._thread.join(60)

    async def _serve(self) -> None:
        loop, over = asyncio.get_running_loop(), asyncio.Event()
        self._loop = loop
        self._end = lambda: loop.call_soon_threadsafe(over.set)
        self.station = pa.open_station(
            pa.load_site(),
            approver=pa.leave_to_clients,
            engine=self.engine.engine(),
            log=self.log,
        )
        try:
            async with self.station, self.station.served() as served:
                self.address = served.address
                for person, role in PEOPLE.items():
                    self.tokens[person] = served.make_token(role, person)
                    self.tokens.setdefault(role, self.tokens[person])
                self._begun.set_result(None)
                await over.wait()
        except BaseException as error:
            if not self._begun.done():
                self._begun.set_exception(error)
            raise

    def happens(self, incident: dict[str, object], seconds: float) -> None:
        """Let something happen, and let so many simulated seconds pass."""

        async def happens() -> None:
            self.station.inject(incident)
            await self.station.advance(seconds)

        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(happens(), self._loop).result(timeout=300)

    @contextmanager
    def at_rest(self) -> Generator[None]:
        """Let the service do nothing in the block: its event loop waits for the end of it."""
        assert self._loop is not None
        over = Event()
        self._loop.call_soon_threadsafe(over.wait)
        try:
            yield
        finally:
            over.set()

    def ask(self, method: str, path: str, role: str = "operator", **how: Any) -> httpx.Response:
        """Return the answer to one request with the token of a role or person, '' for none."""
        headers = dict(how.pop("headers", {}))
        if role:
            headers["Authorization"] = f"Bearer {self.tokens.get(role, role)}"
        return self._client.request(method, self.address + path, headers=headers, **how)

    def until(self, path: str, found: Callable[[Any], Any], role: str = "observer") -> Any:
        """Ask for `path` until `found` says something of the answer, and return that."""
        while not (result := found(self.ask("GET", path, role).json())):
            pass
        return result

    def waiting(self, text: str) -> dict[str, Any]:
        """Give a mission and return its plan when it waits."""
        mission = self.ask("POST", "/v1/missions", json={"text": text}).json()
        return self.until(
            "/v1/plans",
            lambda plans: next((p for p in plans if p["mission"]["id"] == mission["id"]), None),
        )

    def ended(self, mission: str) -> dict[str, Any]:
        """Return a mission when it is over."""
        return self.until(f"/v1/missions/{mission}", lambda one: one if one["status"] else None)

    @property
    def decided(self) -> list[pa.Event]:
        """The decisions that the log tells of."""
        return [event for event in pa.read_log(self.log) if event.data.kind == "decision_made"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Return a session that is served to the tests of a file."""
    folder = tmp_path_factory.mktemp("served")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(KEY_VARIABLE, str(folder / "key" / "key.pem"))
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        patch.setitem(http_app.RATES, "writes", (0.001, WRITES_AT_ONCE))
        patch.setitem(http_app.RATES, "questions", (0.001, ASKS_AT_ONCE))
        served = Site(folder)
        served.start()
        yield served
        served.close()
