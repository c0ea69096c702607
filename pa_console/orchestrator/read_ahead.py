"""Lets the model read what is known before a mission is: fixed parts, and the present picture."""

import asyncio
from contextlib import suppress

from pa_console.llm.errors import EngineError
from pa_console.orchestrator.digest import digest_picture
from pa_console.orchestrator.selection import is_small
from pa_console.orchestrator.services import Services
from pa_console.schema.event import Role
from pa_console.schema.telemetry import Digest

ROLES: tuple[Role, ...] = ("planner", "judge", "outcome")
TYPING_ROLES: tuple[Role, ...] = ("planner", "judge")


class ReadAhead:
    """Reads the beginning of coming prompts while nobody waits; a real prompt interrupts it."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self._read: dict[Role, Digest | None] = {}
        self._wanted = asyncio.Event()
        self._turn = asyncio.Lock()

    async def load(self) -> None:
        """Load the model and read the beginning of every role's prompts."""
        async with self._turn:
            with suppress(EngineError):  # told by the engine's state, and to whoever asks it
                await self._services.engine.start()
                for role in ROLES:
                    await self._warm(role)

    async def read_now(self) -> None:
        """Read the picture as it is; when this returns, a mission finds it read."""
        async with self._turn:
            for role in TYPING_ROLES:
                await self._warm(role)

    def typing(self) -> None:
        """Note that a mission is being typed: what the picture has become is worth reading."""
        self._wanted.set()

    async def serve(self) -> None:
        """Read the picture again whenever somebody types, for ever."""
        while True:
            await self._wanted.wait()
            self._wanted.clear()
            await self.read_now()

    async def _warm(self, role: Role) -> None:
        """Let the model read what a prompt of `role` begins with at present, unless it has.

        In a world too large to be told whole, what is told depends on the mission.
        """
        services = self._services
        sim = services.sim
        whole = is_small(sim.world)
        digest = digest_picture(sim.picture(), sim.world) if whole else None
        if services.engine.busy or self._read.get(role, "never") == digest:
            return
        self._read[role] = digest
        prompt = services.dialect.ahead(role, sim.world, digest)
        await services.engine.warm(role, prompt.system, prompt.user)
