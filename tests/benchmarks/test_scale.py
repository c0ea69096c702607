"""The scale benchmark on a small world: every cost is there, the prompt speaks of the gate."""

from pathlib import Path

import pytest

from pa_console.llm.backend import EngineDiedError, GenerationEnd
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.finding import Usage
from pa_console.station.assembly import Site
from tests.benchmarks.scale import count_tokens, measure
from tests.llm.scripted import ScriptedEngine


def test_a_size_is_measured_whole(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.benchmarks.scale.SIMULATED_S", 2.0)
    found = measure(3, 6, site.rulebook, "compact", seed=1)
    assert (found.row.gates, found.row.assets) == (3, 6)
    assert len(found.world.assets) == len(found.picture.assets) == 6
    for name, value in found.row.model_dump().items():
        assert value > 0, name
    assert found.world.gates[0] in found.prompt.user
    assert found.row.prompt_characters == len(found.prompt.system) + len(found.prompt.user)
    assert found.picture.tracks


async def test_tokens_are_those_of_the_models_own_count() -> None:
    model, prompt = LocalModel("scripted", Path("none.gguf"), "0" * 64), Prompt("system", "user")
    engine = ScriptedEngine(model, ["{", GenerationEnd("{", Usage(prompt_tokens=321), "length")])
    assert await count_tokens(engine, prompt) == 321
    [request] = engine.requests
    assert (request.system, request.user, request.max_tokens) == ("system", "user", 1)
    with pytest.raises(EngineDiedError):
        await count_tokens(ScriptedEngine(model, [EngineDiedError("died")]), prompt)
