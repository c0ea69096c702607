"""The second reader on a server: what an order asks, in canonical clauses, by a model untrained.

It is shown the forms of clauses with examples, and the same picture. A server cannot be held to the
clauses, so what it says is read with their own grammar afterwards, and is no reading otherwise.
"""

import json
from dataclasses import replace

import regex

from pa_console.llm.engine.protocol import Answering, Request, confidence
from pa_console.llm.roles.answer_schema import TEXT, Schema
from pa_console.llm.roles.compact_prompt import compact_picture
from pa_console.llm.roles.engine_call import ask_model
from pa_console.llm.roles.judge import OrderRead
from pa_console.llm.roles.prompts import Prompt, mission_line
from pa_console.orders.clause_grammar import grounded_asked
from pa_console.orders.clauses import ASKED
from pa_console.schema.mission import Mission
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

READER = """\
Read an order to a team at a checkpoint and say what it asks, in these clauses and no other words.
Do not plan it. Write one JSON object. Several clauses are separated by "; ".
WHO to PLACE; WHO look at GATE; WHO identify at GATE; WHO warn at GATE; WHO block GATE;
WHO hold; WHO home; report; cover GATE; cover GATE by WHO; WHO relieves ASSET at GATE;
swap ASSET and ASSET; all free to GATE; use force
WHO is an asset's name, or a number with a kind: 1 drone, 2 vehicles, 1 robot, all drones.

Mission: "Get a couple of cars over to MillGate."
{"asked": "2 vehicles to MillGate"}
Mission: "Kite_3 is nearly flat, bring it in."
{"asked": "Kite_3 home"}
Mission: "Have a look at what is going on at DockGate."
{"asked": "1 drone look at DockGate"}
Mission: "Somebody find out who that is at DockGate, and tell him to leave."
{"asked": "1 robot identify at DockGate; 1 robot warn at DockGate"}
Mission: "Nobody watches MillGate any more."
{"asked": "cover MillGate"}
Mission: "Guard_2 and Mule_1, do not move."
{"asked": "Guard_2, Mule_1 hold"}
Mission: "Anything new?"
{"asked": "report"}
"""

SCHEMA: Schema = {
    "type": "object",
    "properties": {"asked": TEXT},
    "required": ["asked"],
    "additionalProperties": False,
}
MAX_TOKENS = 160
DEADLINE_S = 60.0


def reading_prompt(world: World, digest: Digest, mission: Mission) -> Prompt:
    """Return what a server's model is told of an order: the clauses, the picture, the words."""
    return Prompt(READER, f"{compact_picture(world, digest)}{mission_line(mission.text)}")


class ServerReader:
    """Reads orders with the model of a server."""

    def __init__(self, engine: Answering) -> None:
        self._engine = engine

    @property
    def model(self) -> str:
        """The name of the model that answers."""
        return self._engine.model.name

    async def read(self, world: World, digest: Digest, mission: Mission) -> OrderRead:
        """Return what `mission` asks, as far as that is in canonical clauses about what there is.

        Never raises EngineError.
        """
        prompt = reading_prompt(world, digest, mission)
        asked = Request(
            "judge", prompt.system, prompt.user, "", MAX_TOKENS, DEADLINE_S, schema=SCHEMA
        )
        answer = await ask_model(self._engine, asked)
        if answer.error:
            return OrderRead("", answer.error, answer.usage)
        try:
            words = str(json.loads(answer.text)["asked"])
        except (ValueError, KeyError, TypeError):
            return OrderRead("", "its answer is not of the form asked for", answer.usage)
        read = OrderRead(f"{ASKED}{words}", usage=answer.usage)
        if not in_clauses(world, digest, mission.text, read.asked):
            return replace(read, asked="", error=f"no reading in canonical clauses: {words[:120]}")
        return replace(read, confidence=confidence(answer.chances, answer.text, words))


def in_clauses(world: World, digest: Digest, words: str, asked: str) -> bool:
    """Whether `asked` is what a judge of an order in those `words` could have been held to."""
    patterns = grounded_asked(world, digest, words)
    return all(regex.fullmatch(pattern, asked, flags=regex.V1) for pattern in patterns)
