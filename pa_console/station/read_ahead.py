"""Reading ahead: the models read the known parts of a prompt before a mission is given.

Those are the fixed parts, the present picture, and for a mission that is being typed the rules that
concern its words so far, and these words. The second reader is started by the first words that are
typed and reads them after the planner and the judge.
"""

import asyncio
from contextlib import suppress

from pa_console.language.references.conversation import Unclear
from pa_console.language.references.resolution import resolve
from pa_console.llm.backend import EngineError
from pa_console.llm.local.engine import Engine
from pa_console.llm.roles.clause_reader import ClauseReader, reading_prefix
from pa_console.mission.context import Services
from pa_console.mission.orders.spelling import prepare, read_words
from pa_console.mission.planning.picture_text import digest_picture, is_small
from pa_console.schema.events.event import Role
from pa_console.schema.telemetry import Digest

ROLES: tuple[Role, ...] = ("planner", "judge", "outcome")
TYPING_ROLES: tuple[Role, ...] = ("planner", "judge")


class ReadAhead:
    """Reads the beginning of coming prompts while nobody waits; a real prompt interrupts it."""

    def __init__(self, services: Services, *, unasked: bool = True) -> None:
        """`unasked`: read too what nobody has asked for yet, when a session or a mission begins."""
        self._services, self._unasked = services, unasked
        self._read: dict[tuple[Engine, Role], tuple[Digest | None, str]] = {}
        self._typed = ""
        self._wanted = asyncio.Event()
        self._turn = asyncio.Lock()

    def use(self, services: Services) -> None:
        """Use these services from now on, and read everything again."""
        self._services = services
        self._read.clear()

    async def load(self) -> None:
        """Load the model and the dictionary and, `unasked`, read how every role's prompts begin."""
        async with self._turn:
            with suppress(EngineError):  # told by the engine's state, and to whoever asks it
                await self._services.engine.start()
                await asyncio.to_thread(prepare)
                for role in ROLES if self._unasked else ():
                    await self._warm(self._services.engine, role)

    def typing(self, text: str) -> None:
        """Note that a mission is being typed and is `text` so far."""
        self._typed = text
        self._wanted.set()

    async def serve(self) -> None:
        """Read the picture again whenever the operator types, until cancelled."""
        while True:
            await self._wanted.wait()
            self._wanted.clear()
            await self.read_now(self._typed)

    async def read_now(self, text: str = "") -> None:
        """Read the picture as it is, and all of `text` but its last word, which may not be whole.

        When this returns, a mission that begins so finds it read.
        """
        async with self._turn:
            services = self._services
            scene = services.scene
            read = read_words(text.rpartition(" ")[0], scene.world, services.rulebook)
            found = resolve(scene, read, {})
            read = read if isinstance(found, Unclear) else found.text
            for role in TYPING_ROLES:
                await self._warm(services.engine, role, read)
            second = services.engine.second_reader
            if second is not None and services.variant.read_again:
                await self._warm(second, "judge", read)

    async def _warm(self, engine: Engine, role: Role, words: str = "") -> None:
        """Let `engine` read what a prompt of `role` begins with at present, unless it has.

        In a world too large to be told whole, what is told depends on the mission.
        """
        services = self._services
        fleet = services.fleet
        whole = is_small(fleet.world)
        digest = digest_picture(fleet.picture(), fleet.world) if whole else None
        if services.engine.busy or self._read.get((engine, role)) == (digest, words):
            return
        self._read[engine, role] = (digest, words)
        if isinstance(services.second_reader, ClauseReader) and engine is not services.engine:
            prompt = reading_prefix(fleet.world, digest)
            await engine.warm(role, prompt.system, prompt.user)
            return
        prompt = services.prompt_format.ahead(role, fleet.world, digest)
        if services.prompt_format.typed is not None and digest is not None and words.strip():
            hits = services.retriever.retrieve(words, services.top_k)
            rules = [services.rulebook.get(hit.rule_id) for hit in hits]
            prompt = services.prompt_format.typed(role, fleet.world, digest, rules, words)
        await engine.warm(role, prompt.system, prompt.user)
