"""Adapters: found and checked, switched per role, and no answer depends on what came before."""

import asyncio
import hashlib
from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path

import pytest
import pytest_asyncio
from pydantic import ValidationError

from pa_console.llm.backend import GenerationEnd, ModelError, ModelUnavailableError, Request
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import (
    AdapterFile,
    LocalAdapter,
    LocalModel,
    ModelEntry,
    PathSource,
    check_adapters,
    find_model,
)
from tests.llm.asking import answer

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

TALK = Request(
    role="planner",
    system="You talk about the river gate and those who come to it. " * 8,
    user="A truck waits at the river gate. Say what you think of it.",
    grammar="start: /.{40,50}/",
    max_tokens=60,
    deadline_s=600,
)
OTHER = replace(TALK, user="A truck waits at the hill gate. Say what you think of it.")


@pytest.fixture(scope="module")
def adapted(smallest_model: LocalModel) -> LocalModel:
    """The default model: the smallest with the shipped adapters of planner and judge."""
    model = find_model(None)
    assert model.path == smallest_model.path
    return model


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def engine(adapted: LocalModel) -> AsyncGenerator[Engine]:
    engine = Engine(adapted)
    yield engine
    await engine.close()


async def fresh(model: LocalModel, request: Request) -> GenerationEnd:
    """Return the answer of an engine that was asked nothing before."""
    engine = Engine(model)
    try:
        return await answer(engine, request)
    finally:
        await engine.close()


@pytest.mark.asyncio(loop_scope="module")
async def test_answers_do_not_depend_on_what_other_roles_were_asked(
    engine: Engine, adapted: LocalModel
):
    judged, watched = replace(OTHER, role="judge"), replace(OTHER, role="outcome")
    for request in (TALK, replace(TALK, role="judge"), OTHER, judged, TALK, watched, judged):
        await answer(engine, request)
    planned, judgement = await answer(engine, OTHER), await answer(engine, judged)
    assert planned.usage.cached_tokens >= 64
    assert judgement.usage.cached_tokens >= 64
    assert planned.text == (await fresh(adapted, OTHER)).text
    assert judgement.text == (await fresh(adapted, judged)).text
    assert judgement.text == (await answer(engine, watched)).text
    assert planned.text != judgement.text


@pytest.mark.asyncio(loop_scope="module")
async def test_several_answers_at_once_come_from_the_adapter_of_their_role(
    engine: Engine, adapted: LocalModel
):
    several = replace(OTHER, count=2)
    planned = await answer(engine, several)
    judged = await answer(engine, replace(several, role="judge"))
    assert len(planned.texts) == 2
    assert (await answer(engine, several)).texts == planned.texts
    assert planned.texts != judged.texts
    assert (await fresh(adapted, several)).texts == planned.texts


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.parametrize("count", [1, 4])
async def test_a_cancelled_answer_changes_none_that_follow(engine: Engine, count: int):
    before = await answer(engine, OTHER)
    long = replace(OTHER, role="judge", grammar="start: /[a-z ]{900,950}/", max_tokens=400)
    writing = asyncio.create_task(answer(engine, replace(long, count=count)))
    await asyncio.sleep(0)
    while not engine.busy:
        await asyncio.sleep(0)
    engine.cancel()
    assert (await writing).finish == "cancelled"
    assert (await answer(engine, OTHER)).text == before.text


@pytest.mark.asyncio(loop_scope="module")
async def test_the_engine_tells_which_adapters_it_answers_with(
    engine: Engine, adapted: LocalModel, smallest_model: LocalModel
):
    assert set(engine.info.adapters) == {"planner.lora.gguf", "judge.lora.gguf"}
    assert adapted.fingerprint != smallest_model.fingerprint == smallest_model.sha256


@pytest.mark.asyncio(loop_scope="module")
async def test_a_file_that_is_no_adapter_of_the_model_makes_it_unavailable(
    smallest_model: LocalModel, tmp_path: Path
):
    path = tmp_path / "odd.lora.gguf"
    path.write_bytes(b"GGUF but not really")
    model = replace(smallest_model, adapters=(LocalAdapter("judge", path, hash_file(path)),))
    with pytest.raises(ModelUnavailableError, match=r"odd\.lora\.gguf: not a sound GGUF file"):
        await fresh(model, TALK)


def entry(**more: object) -> ModelEntry:
    about: dict[str, object] = {
        "name": "m",
        "title": "M",
        "licence": "none",
        "parameters": "1",
        "quantisation": "Q8_0",
        "size_mb": 1,
        "sha256": None,
        "sources": (PathSource(path="none.gguf"),),
    }
    return ModelEntry.model_validate(about | more)


def test_outcomes_are_judged_with_the_adapter_of_the_judge(tmp_path: Path):
    path = tmp_path / "judge.gguf"
    path.write_bytes(b"adapter")
    sha256 = hashlib.sha256(b"adapter").hexdigest()
    found = check_adapters("m", {"judge": AdapterFile(file=str(path), sha256=sha256)})
    assert {adapter.role: adapter.path for adapter in found} == {"judge": path, "outcome": path}


def test_a_missing_adapter_is_named_with_the_remedy():
    file = AdapterFile(file="gone.lora.gguf", sha256="0" * 64)
    with pytest.raises(ModelError, match=r"gone\.lora\.gguf: the judge adapter of m .* install"):
        check_adapters("m", {"judge": file})


def test_an_adapter_with_another_hash_is_named_with_the_remedy(tmp_path: Path):
    path = tmp_path / "planner.gguf"
    path.write_bytes(b"another")
    file = AdapterFile(file=str(path), sha256="0" * 64)
    with pytest.raises(ModelError, match=r"planner\.gguf: not the planner adapter .* install"):
        check_adapters("m", {"planner": file})


def test_compact_prompts_are_for_models_with_both_adapters():
    assert entry().prompts == "clauses"
    planner = {"planner": {"file": "p.gguf", "sha256": "0" * 64}}
    with pytest.raises(ValidationError, match="needs an adapter for planner and for judge"):
        entry(prompts="compact", adapters=planner)
    assert entry(prompts="compact", adapters=planner | {"judge": planner["planner"]})
