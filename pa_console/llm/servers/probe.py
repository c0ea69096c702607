"""Probes which way of constraining an answer holds on a server, with unguessable words.

A server that ignores a field answers all the same. So every way is tried with a schema of random
words that the prompt does not mention: only a constrained answer has them.
"""

import secrets
import string
from contextlib import aclosing
from dataclasses import dataclass, field

from pa_console.llm.errors import ServerError
from pa_console.llm.roles.answer_schema import Schema
from pa_console.llm.servers.client import ServerClient
from pa_console.llm.servers.constraints import WAYS, Way

PROMPT = "Say hello."
PROBE_TOKENS = 48
PROBE_S = 20.0
"""The longest time of one probe, seconds."""
REFUSES = (400, 404, 415, 422, 500, 501)
"""The status codes of servers for a field, or a value of it, that they do not accept."""
WORD = 8
HOLDS, IGNORED = "holds", "ignored"


@dataclass(frozen=True)
class ProbeReport:
    """The result of every way, in words, and whether token probabilities are reported."""

    ways: dict[Way, str] = field(default_factory=dict[Way, str])
    chances: bool = False

    @property
    def way(self) -> Way | None:
        """The best way that holds; None where none does."""
        return next((way for way, found in self.ways.items() if found == HOLDS), None)

    @property
    def summary(self) -> str:
        """The conclusion, in a sentence."""
        return f"answers are held to their form by {self.way}" if self.way else UNCONSTRAINED

    @property
    def told(self) -> str:
        """All of it on a line."""
        ways = ", ".join(f"{way} {found}" for way, found in self.ways.items())
        return f"{self.summary} ({ways}); token chances {'told' if self.chances else 'not told'}"


UNCONSTRAINED = "nothing holds answers to their form, so one that cannot be read is asked for again"


async def probe(client: ServerClient, within_s: float = PROBE_S) -> ProbeReport:
    """Try every way, and token probabilities; each try may take `within_s` seconds.

    Raises ServerError when the server cannot be reached, is too slow or refuses every question.
    """
    chances = bool(await _asked(client, {}, within_s, chances=True, refused_too=True))
    if not chances:
        await _asked(client, {}, within_s)
    found: dict[Way, str] = {}
    for way in WAYS:
        found[way] = await _tried(client, way, within_s)
    return ProbeReport(found, chances)


async def _tried(client: ServerClient, way: Way, within_s: float) -> str:
    key, word = _random_word(), _random_word()
    schema: Schema = {
        "type": "object",
        "properties": {key: {"type": "string", "enum": [word]}},
        "required": [key],
        "additionalProperties": False,
    }
    held, text = f'{{"{key}":"{word}"}}', ""
    try:
        async with aclosing(
            client.ask("", PROMPT, PROBE_TOKENS, within_s, WAYS[way](schema))
        ) as pieces:
            async for piece in pieces:
                text += "".join(piece.text.split())
                if not held.startswith(text):
                    return IGNORED
    except ServerError as error:
        if error.status not in REFUSES:
            raise
        return f"refused ({error.status})"
    return HOLDS if text == held else IGNORED


async def _asked(
    client: ServerClient,
    extra: Schema,
    within_s: float,
    *,
    chances: bool = False,
    refused_too: bool = False,
) -> int:
    """Ask for a few words; return of how many tokens the chance was told."""
    told = 0
    try:
        async for piece in client.ask("", PROMPT, 4, within_s, extra, chances=chances):
            told += len(piece.chances)
    except ServerError as error:
        if not refused_too or error.status not in REFUSES:
            raise
    return told


def _random_word() -> str:
    return "".join(secrets.choice(string.ascii_lowercase) for _ in range(WORD))
