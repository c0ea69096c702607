"""STOP over HTTP while strangers load the port.

The service is a process with a simulated team; so are the strangers. Measured is the time from a
client's first attempt until its stop is answered, connections that were turned away included, and
what the log says of the holds.
"""

import asyncio
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from random import Random
from typing import Any

from pa_console.fleets.vda5050.broker import LOOPBACK
from tests.attacks.loads import KINDS, Address, request
from tests.cli.outside import Outside
from tests.fleets.broker import free_port

NONE, AGENTS = "none", "agents' port, "
LOADS = (NONE, *KINDS, *(f"{AGENTS}{kind}" for kind in ("idle", "large")))
"""Nothing, each kind of load at the port for clients, and some at the port for agents."""
ASSETS = 8
"""The assets of the checkpoint."""
LIMIT_S = 60.0


@dataclass
class Stopped:
    """What came of the stops under one load; times in milliseconds."""

    load: str
    answered_ms: list[float] = field(default_factory=list[float])
    """From a client's first attempt to its answer."""
    turned_away: int = 0
    """Attempts that were cut off."""
    held_ms: list[float] = field(default_factory=list[float])
    """From each stop to the last of its holds, by the log."""
    short: int = 0
    """Stops with fewer holds than there are assets."""

    def summary(self) -> str:
        """Return it in words."""
        return (
            f"{self.load}: {len(self.answered_ms)} stops, answered {_shares(self.answered_ms)}; "
            f"all holds on the link {_shares(self.held_ms)}; attempts turned away "
            f"{self.turned_away}; stops without a hold for every asset {self.short}"
        )


def _shares(found: list[float]) -> str:
    if not found:
        return "never"
    ranked = sorted(found)
    p50, p99 = (ranked[min(int(part * len(ranked)), len(ranked) - 1)] for part in (0.5, 0.99))
    return f"p50 {p50:.1f} ms, p99 {p99:.1f} ms, most {ranked[-1]:.1f} ms"


class Served:
    """A session that is served in a process of its own, with a port for agents."""

    def __init__(self, folder: Path) -> None:
        agents = free_port()
        self.outside = Outside(
            folder, "serve", "--port", "0", "--agents", str(agents), "--no-alarms", terminal=True
        )
        self.outside.until_shown("Ctrl-C ends the session")
        (port,) = re.findall(r"http://127\.0\.0\.1:(\d+)/docs", self.outside.shown)
        (self.token,) = re.findall(r"^(pa_\S+)", self.outside.shown, re.MULTILINE)
        self.address: Address = (LOOPBACK, int(port))
        self.for_agents: Address = (LOOPBACK, agents)

    async def stop(self, found: Stopped) -> None:
        """Stop everything as a client does that tries until it is answered."""
        bearer = f"Authorization: Bearer {self.token}"
        asked = request(self.address, "POST", "/v1/stop", bearer, "Content-Length: 0")
        began = time.perf_counter()
        async with asyncio.timeout(LIMIT_S):
            while True:
                try:
                    reader, writer = await asyncio.open_connection(*self.address)
                    writer.write(asked)
                    answer = await reader.readline()
                    writer.close()
                except OSError:
                    answer = b""
                if b" 204 " in answer:
                    break
                found.turned_away += 1
        found.answered_ms.append((time.perf_counter() - began) * 1e3)

    async def logged(self, stops: int) -> None:
        """Wait until the log has so many stops in all, each with its holds."""
        async with asyncio.timeout(LIMIT_S):
            while True:
                told = Counter(self.outside.kinds)
                if told["all_stopped"] >= stops and told["command_sent"] >= ASSETS * stops:
                    return
                await asyncio.sleep(0.05)

    def look(self, found: Stopped, stops: int) -> None:
        """Read in the log what came of the last `stops` stops."""
        records = self.outside.records
        at = [number for number, record in enumerate(records) if record["kind"] == "all_stopped"]
        for number, begin in enumerate(at[-stops:]):
            end = [*at[-stops:], len(records)][number + 1]
            holds = [_time(one) for one in records[begin:end] if one["kind"] == "command_sent"]
            found.short += len(holds) < ASSETS
            if holds:
                found.held_ms.append((max(holds) - _time(records[begin])) * 1e3)


def _time(record: dict[str, Any]) -> float:
    return datetime.fromisoformat(record["t"]).timestamp()


@contextmanager
def loaded(load: str, served: Served) -> Generator[None]:
    """Load the session in the block."""
    if load == NONE:
        yield
        return
    host, port = served.for_agents if load.startswith(AGENTS) else served.address
    kind = load.removeprefix(AGENTS)
    words = (sys.executable, "-m", "tests.attacks.loads", kind, host, str(port))
    strangers = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        assert strangers.stdout is not None
        strangers.stdout.readline()
        yield
    finally:
        strangers.kill()
        strangers.wait()


def campaign(count: int, seed: int) -> tuple[list[str], list[str]]:
    """Stop everything `count` times under each load; return what came of it and what was amiss."""
    random, found = Random(seed), list[Stopped]()

    async def press(under: Stopped) -> None:
        for _ in range(count):
            await asyncio.sleep(random.uniform(0.0, 0.1))
            await served.stop(under)

    with tempfile.TemporaryDirectory() as name:
        served = Served(Path(name))
        try:
            for load in LOADS:
                found.append(Stopped(load))
                with loaded(load, served):
                    asyncio.run(press(found[-1]))
                asyncio.run(served.logged(count * len(found)))
                served.look(found[-1], count)
        finally:
            served.outside.close()
    whole = [len(one.answered_ms) == len(one.held_ms) == count and not one.short for one in found]
    amiss = [one.load for one, sound in zip(found, whole, strict=True) if not sound]
    return [one.summary() for one in found], amiss
