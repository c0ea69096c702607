"""The speed of the model as `doctor` measures it: one plan, in ten seconds at most."""

import asyncio
from contextlib import aclosing
from datetime import UTC, datetime

from pa_console.cli.doctor.checks import Check
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.backend import Completed, EngineError, ModelError, Request
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.mission.context import Services
from pa_console.mission.propose import ask_for_plan
from pa_console.mission.retrieve import Retrieved
from pa_console.policy.retriever import Retriever
from pa_console.schema.evaluation import Variant
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Mission
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site

NAME = "model's speed"
LIMIT_S = 10.0
"""The longest measurement, seconds: `doctor` has to end soon."""

ENOUGH_S = 5.0
"""The time, seconds, within which a plan comes while the operator still looks at the screen."""

TEXT = "Send a drone to look at the east gate."
REMEDY = "close other programs, or choose a smaller model: pa-console models list"


def check_speed(name: str) -> Check:
    """Let the model `name` (empty: the default one) write one plan, if it is on this machine."""
    try:
        model = find_model(name or None)
    except ModelError as error:
        return Check(NAME, "ok", f"not measured: {error}")
    try:
        return speed_words(model.name, asyncio.run(_one_plan(model)))
    except TimeoutError:
        found = f"{model.name} did not write a plan within {LIMIT_S:g} s: too slow to work with"
        return Check(NAME, "warning", found, REMEDY)
    except EngineError as error:
        return Check(NAME, "warning", f"{model.name}: {error}", "see the checks of the model")


def speed_words(name: str, usage: Usage) -> Check:
    """Return the speed of this machine as the time of one plan of the model `name`."""
    read = usage.prompt_tokens - usage.cached_tokens
    found = (
        f"{name} reads {_rate(read, usage.first_token_s)} and writes "
        f"{_rate(usage.completion_tokens, usage.seconds - usage.first_token_s)} tokens/s: "
        f"a plan takes {usage.seconds:.1f} s"
    )
    if usage.seconds <= ENOUGH_S:
        return Check(NAME, "ok", f"{found}, fast enough")
    return Check(NAME, "warning", f"{found}, slow: expect to wait for it", REMEDY)


def _rate(tokens: int, seconds: float) -> str:
    return f"{tokens / seconds:.0f}" if seconds > 0.0 else "?"


async def _one_plan(model: LocalModel) -> Usage:
    """Return what a plan costs; raises TimeoutError after LIMIT_S, and EngineError."""
    site = load_site("checkpoint", "checkpoint")
    engine = Engine(model)
    try:
        async with asyncio.timeout(LIMIT_S):
            fleet = SimulatedFleet(Checkpoint(site.world))
            services = Services.open(fleet, site.rulebook, engine, Variant())
            mission = Mission(id="doctor", text=TEXT, created=datetime.now(UTC))
            hits = Retriever(site.rulebook.rules).retrieve(TEXT)
            question = ask_for_plan(services, Retrieved(mission, hits))
            request = Request(
                "planner",
                question.prompt.system,
                question.prompt.user,
                question.grammar,
                services.prompt_format.plan_tokens,
                LIMIT_S,
            )
            async with aclosing(engine.generate(request)) as items:
                async for item in items:
                    if isinstance(item, Completed):
                        return item.usage
    finally:
        await engine.close()
    raise EngineError("the model's answer has no end")
