"""The checks of the models: their files, their servers, and this machine's memory and speed."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import aclosing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter, sleep

from pa_console.cli.verbs.doctor.checks import Check
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.backend import (
    BackendOptions,
    EngineError,
    GenerationEnd,
    ModelError,
    Request,
    open_backend,
)
from pa_console.llm.local.confinement import REMEDY, Restriction, try_out
from pa_console.llm.local.engine import Engine
from pa_console.llm.local.threads import idle_seconds, physical_cores
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import (
    Catalog,
    LocalModel,
    ModelEntry,
    check_adapters,
    find_model,
)
from pa_console.llm.models.preparing import Preparation, find_recorded
from pa_console.llm.remote.address import KEY_VARIABLES, ServerKey
from pa_console.llm.remote.engine import ServerEngine
from pa_console.llm.remote.servers import SessionModels, session_models
from pa_console.mission.context import Services
from pa_console.mission.planning.propose import ask_for_plan
from pa_console.mission.retrieve import RetrievedRules
from pa_console.policy.retriever import Retriever
from pa_console.schema.document import DocumentError
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import ServerUse
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Mission
from pa_console.schema.text import count
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site

SECOND_READER = "second reader"
PINNED = "SHA-256 matches the catalogue"
WORK_MB = 500
"""The memory in megabytes for the console and both models' processes, without the weights.

400 MB were measured.
"""
MEMORY = Path("/proc/meminfo")
SMALLER = "close other programs, or choose a smaller model: pa-console models list"

LOOK_S = 0.4
"""The duration of the measurement of the load, in seconds."""
QUIET_SHARE = 0.2
"""The share of busy cores up to which a machine counts as idle."""

SPEED = "model's speed"
SPEED_MISSION = "Send a drone to look at the east gate."
LIMIT_S = 10.0
"""The longest measurement of the speed, in seconds; `doctor` must not take long."""
ENOUGH_S = 5.0
"""The longest time for a plan, in seconds, during which an operator keeps watching the screen."""

SERVER = "model server"


def check_model(name: str) -> Iterator[Check]:
    """Check the model `name` ('' for the default): its files, their hashes and the memory."""
    try:
        catalog = Catalog.load()
        entry = catalog.get(name or catalog.default)
    except (ModelError, DocumentError) as error:
        yield Check("model", "missing", str(error), "choose another model: pa-console models list")
        return
    yield check_files(entry)
    needed_mb = _loaded_mb(entry)
    if entry.second_reader:
        second = catalog.get(entry.second_reader)
        yield _check_second_reader(second)
        needed_mb += _loaded_mb(second) if second.local_file else 0
    yield check_memory(needed_mb)


def check_files(entry: ModelEntry) -> Check:
    """Check every loaded file of a model against its pinned hash."""
    path, pull = entry.local_file, f"pa-console models pull {entry.name}"
    if path is None:
        return Check(
            "model", "missing", f"{entry.name} is not downloaded ({entry.size_mb} MB)", pull
        )
    try:
        digest = entry.check(path)
        adapters = check_adapters(entry.name, entry.adapters)
    except (ModelError, OSError) as error:
        return Check("model", "missing", str(error), f"rm '{path}'; {pull}")
    pinned = entry.sha256 is not None
    parts = [f"{path}: {PINNED if pinned else 'not verified, the catalogue has no hash'}"]
    if entry.how is not None:
        good, words = _prepared(entry, entry.how, digest)
        if not good:
            return Check("model", "missing", f"{entry.name}: {words}", pull)
        parts.append(words)
    if files := {item.path for item in adapters}:
        parts.append(f"{count(len(files), 'adapter')}: {PINNED}")
    remedy = "choose a model with a hash in the catalogue"
    return Check.graded("model", pinned, f"{entry.name}: {'; '.join(parts)}", remedy)


def _prepared(entry: ModelEntry, how: Preparation, source_sha256: str) -> tuple[bool, str]:
    """Return whether the prepared file is valid or is still to be made, and the reason in words."""
    path, pin = entry.prepared_file, entry.pin(how)
    if path is None:
        then = "compared with the catalogue's hash" if pin else "signed with this machine's key"
        return True, f"{how} weights: prepared at the first start and {then}"
    if pin:
        digest = hash_file(path)
        if digest == pin:
            return True, f"{path}, the loaded file: {PINNED} for {how}"
        return False, (
            f"{path}: the {how} weights do not match the catalogue: their SHA-256 is {digest}, "
            f"expected {pin}; they are never loaded, and the next start prepares them again"
        )
    if find_recorded(entry.stem, how, source_sha256) is not None:
        return True, (
            f"{path}, the loaded file: SHA-256 matches the record signed with this machine's key; "
            f"the catalogue has no hash for {how}"
        )
    return False, (
        f"{path}: no record signed with this machine's key matches, and the catalogue has no hash "
        f"for {how} weights; they are never loaded, and the next start prepares them again"
    )


def _loaded_mb(entry: ModelEntry) -> int:
    """Return the size of the model's file in megabytes, or of its download if it is missing."""
    file = entry.prepared_file or entry.local_file
    return entry.size_mb if file is None else file.stat().st_size // 10**6


def _check_second_reader(entry: ModelEntry) -> Check:
    """Check the second reader; the console also works without it."""
    if entry.local_file is None:
        pull = f"pa-console models pull {entry.name}"
        result = f"{entry.name} is not downloaded; to read unclear orders with it: {pull}"
        return Check(SECOND_READER, "ok", result)
    return replace(check_files(entry), name=SECOND_READER)


def check_memory(weights_mb: int, memory: Path = MEMORY) -> Check:
    """Check that the free memory is enough for models of `weights_mb`, and count the cores."""
    name, cores, needed = "memory, cores", physical_cores(), weights_mb + WORK_MB
    try:
        lines = dict(line.split(":", 1) for line in memory.read_text(encoding="ascii").splitlines())
        free_mb = int(lines["MemAvailable"].split()[0]) * 1024 // 10**6
    except (OSError, KeyError, ValueError):
        unknown = "the free memory is unknown on this system"
        return Check(name, "ok", f"{count(cores, 'core')}; {unknown}")
    result = f"{free_mb} MB free, {needed} MB needed, {count(cores, 'core')}"
    if free_mb < needed:
        return Check(name, "warning", result, SMALLER)
    return Check.graded(name, cores >= 2, result, "expect slow answers; use at least two cores")


def check_load(
    idle: Callable[[], float | None] = idle_seconds, wait: Callable[[float], None] = sleep
) -> Check:
    """Check for LOOK_S seconds how many cores are busy with other programs."""
    began, before = perf_counter(), idle()
    wait(LOOK_S)
    after, seconds = idle(), perf_counter() - began
    cores = physical_cores()
    if before is None or after is None:
        return Check("load", "ok", "the load is unknown on this system")
    busy = max(0.0, cores - (after - before) / seconds)
    result = f"{busy:.1f} of {count(cores, 'core')} busy"
    remedy = "close other programs; answers take longer under load"
    return Check.graded("load", busy <= cores * QUIET_SHARE, result, remedy)


def check_confinement() -> Check:
    """Check the confinement: attempt the forbidden acts in a process like the model's."""
    return confinement_words(try_out())


def confinement_words(restrictions: tuple[Restriction, ...]) -> Check:
    """Return the check of the confinement of the model's process, with each gap and its reason."""
    held = [item.what for item in restrictions if not item.missing]
    missing = [f"not enforced: {i.what} ({i.missing})" for i in restrictions if i.missing]
    result = "; ".join([*missing, *held]) + ("" if missing else "; tested")
    return Check.graded("model's process", not missing, result, REMEDY)


def check_speed(name: str) -> Check:
    """Check how fast the model `name` ('' for the default) plans, if it is on this machine."""
    try:
        model = find_model(name or None)
    except ModelError as error:
        return Check(SPEED, "ok", f"not measured: {error}")
    try:
        return speed_words(model.name, asyncio.run(_one_plan(model)))
    except TimeoutError:
        result = f"{model.name} did not write a plan within {LIMIT_S:g} s: too slow for work"
        return Check(SPEED, "warning", result, SMALLER)
    except EngineError as error:
        return Check(SPEED, "warning", f"{model.name}: {error}", "see the checks of the model")


def speed_words(name: str, usage: Usage) -> Check:
    """Return the check of this machine's speed, with the time for a plan of the model `name`."""
    prompt_tokens = usage.prompt_tokens - usage.cached_tokens
    fast = usage.seconds <= ENOUGH_S
    result = (
        f"{name} reads {_rate(prompt_tokens, usage.first_token_s)} and writes "
        f"{_rate(usage.completion_tokens, usage.seconds - usage.first_token_s)} tokens/s: "
        f"a plan takes {usage.seconds:.1f} s, "
        f"{'fast enough' if fast else 'slow, expect to wait'}"
    )
    return Check.graded(SPEED, fast, result, SMALLER)


def _rate(tokens: int, seconds: float) -> str:
    return f"{tokens / seconds:.0f}" if seconds > 0.0 else "?"


async def _one_plan(model: LocalModel) -> Usage:
    """Return the usage of one plan; raises TimeoutError after LIMIT_S, and EngineError."""
    site = load_site("checkpoint", "checkpoint")
    engine = Engine(model)
    try:
        async with asyncio.timeout(LIMIT_S):
            fleet = SimulatedFleet(Checkpoint(site.world))
            services = Services.open(fleet, site.rulebook, engine, Variant())
            mission = Mission(id="doctor", text=SPEED_MISSION, created=datetime.now(UTC))
            hits = Retriever(site.rulebook.rules).retrieve(SPEED_MISSION)
            question = ask_for_plan(services, RetrievedRules(mission, hits))
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
                    if isinstance(item, GenerationEnd):
                        return item.usage
    finally:
        await engine.close()
    raise EngineError("the model's answer was incomplete")


def named_models(settings: Settings) -> SessionModels:
    """Return the models in the settings, or only the local model if the settings are not valid."""
    try:
        return session_models(settings.model, settings.judge_server, settings.second_reader)
    except ModelError:
        return SessionModels(settings.model or None)


def check_servers(named: SessionModels, settings: Settings) -> Iterator[Check]:
    """Check every server in `named`; without servers, nothing is sent."""
    if settings.judge_server and "judge" not in named.named:
        remedy = "pa-console settings set judge_server openai:BASE_URL#SERVER"
        yield Check(
            SERVER, "missing", f"judge_server: {settings.judge_server!r} is not a server", remedy
        )
    for use, name in named.named.items():
        yield check_server(use, name, plain=settings.plain_servers)


def check_server(use: ServerUse, name: str, *, plain: bool = False) -> Check:
    """Check the server `name`: how its answers are constrained, and its key."""
    title = f"{SERVER}, {use}"
    try:
        engine = open_backend(name, BackendOptions(use, plain))
    except ModelError as error:
        return Check(title, "missing", str(error), "choose another server, or none")
    if not isinstance(engine, ServerEngine):
        return Check(title, "ok", f"{engine.name}: a backend of another package, not tested")
    asyncio.run(_looked(engine))
    answer = engine.report.words if engine.usable else engine.detail
    key = ServerKey.find(engine.address, KEY_VARIABLES[use])
    if engine.state == "unconstrained":
        remedy = "use a server that constrains answers with a JSON schema or a grammar"
    else:
        remedy = (
            f"start it, and check its address and key ({KEY_VARIABLES[use]}); "
            "until then, the local model answers"
        )
    result = f"{engine.name}: {answer}; key from {key.source}"
    return Check.graded(title, engine.state == "ready", result, remedy)


async def _looked(engine: ServerEngine) -> None:
    try:
        await engine.look()
    finally:
        await engine.close()
