"""The parts of the benchmark that need a model: processes, and what is made of the answers."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pa_console.llm.backend import EngineError
from pa_console.llm.models.catalogue import Catalog, LocalModel, find_model
from pa_console.llm.models.fetching import pull
from pa_console.llm.roles.judge import read_verdict
from pa_console.llm.roles.planner import read_plan
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role
from pa_console.station.assembly import Site
from tests.benchmarks.harness import Memory
from tests.benchmarks.speed.child import Child, LoadWeights
from tests.benchmarks.speed.compare import Bench, Comparison
from tests.benchmarks.speed.decoding import RAW_MODULE, Pass, comparisons, measure_decoding
from tests.benchmarks.speed.measured_missions import OurWay, bench_missions
from tests.benchmarks.speed.messages import (
    MeasureSpeed,
    PlainAnswer,
    PlainAsk,
    Speed,
    plan_schema,
    verdict_schema,
)
from tests.benchmarks.speed.missions import (
    PLAIN_MODULE,
    Measured,
    PlainWay,
    Round,
    measure_missions,
)
from tests.benchmarks.speed.missions import comparisons as mission_comparisons
from tests.scripted import ScriptedEngine, plan

pytestmark = pytest.mark.long

N_CTX = 512
SHORT_VERDICT = '{"feedback": "it fits", "violated": [], "verdict": "Success"}'


@pytest.fixture(scope="module")
def tiny() -> LocalModel:
    """Return the smallest model of the catalogue, fetched once."""
    catalog = Catalog.load()
    pull(catalog.get("smollm2-135m"))
    return catalog.locate("smollm2-135m")


def load(path: Path) -> LoadWeights:
    return LoadWeights(path=str(path), chat="template", n_ctx=N_CTX)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("module", [PLAIN_MODULE, RAW_MODULE])
async def test_a_file_that_is_no_model_is_told_in_words(module: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.gguf"
    path.write_bytes(b"GGUF" + bytes(64))
    with pytest.raises(EngineError, match="broken"):
        await Child.start(module, load(path))


async def test_the_plain_way_answers_by_its_schema_and_its_process_ends_with_it(
    tiny: LocalModel, site: Site
) -> None:
    picture = bench_missions(site.world)[0].sim.picture()
    child = await Child.start(PLAIN_MODULE, load(tiny.path))
    try:
        asks = [
            (plan_schema(site.world, picture), 20),
            (verdict_schema("examples", ["WF-03"]), 120),
        ]
        plan_, verdict = [
            await child.ask(
                PlainAsk(system="Answer.", user="Hold.", answer_schema=schema, max_tokens=most),
                PlainAnswer,
            )
            for schema, most in asks
        ]
        assert '"reason"' in plan_.text
        assert (plan_.completion_tokens, plan_.complete) == (20, False)
        assert '"WF-03"' in verdict.text
        assert verdict.complete == (read_verdict(verdict.text)[0] is not None)
        with pytest.raises(EngineError, match=str(N_CTX)):
            await child.ask(
                PlainAsk(system="a b c " * N_CTX, user="", answer_schema="{}", max_tokens=1),
                PlainAnswer,
            )
    finally:
        await child.close()
    assert not alive(child.pid)


async def test_our_decoder_and_bare_llama_read_the_same_prompt(tiny: LocalModel) -> None:
    ask = MeasureSpeed(
        system="Count.",
        user="Up to three.",
        grammar='start: "one, " /[a-z]/ " and then all of the rest of them."\n',
        max_tokens=40,
    )
    child = await Child.start(RAW_MODULE, load(tiny.path))
    try:
        passes: list[Pass] = []
        for _ in range(2):
            ours = await child.ask(ask, Speed)
            bare = await child.ask(ask.model_copy(update={"bare": ours.answer}), Speed)
            passes.append(Pass(ours=(ours,), bare=(bare,)))
    finally:
        await child.close()
    for one in passes:
        [ours], [bare] = one.ours, one.bare
        assert ours.prompt_tokens == bare.prompt_tokens > 0
        assert ours.answer == bare.answer
        assert ours.answer.read, "the answer begins with words that the grammar forces"
        assert 0 < ours.chosen < len(ours.answer.tokens)
        assert bare.evaluations == len(ours.answer.tokens) - 1 > ours.evaluations
    lines = comparisons(passes)
    assert {line.unit for line in lines} == {"tokens/s"}
    assert all(line.ratio is not None and line.runs == 2 for line in lines)
    [first, _] = passes
    forced = len(first.ours[0].answer.tokens) - first.ours[0].chosen
    assert f"{forced} forced by the grammar" in lines[-1].note


@pytest.mark.parametrize("measure", [measure_decoding, measure_missions])
def test_an_interrupted_part_leaves_no_process(
    tiny: LocalModel,
    site: Site,
    monkeypatch: pytest.MonkeyPatch,
    measure: Callable[[Bench], list[Comparison]],
) -> None:
    started: list[Child] = []
    ask = Child.ask

    async def noted(self: Child, request: StrictModel, reply: type[StrictModel]) -> StrictModel:
        started.append(self)
        return await ask(self, request, reply)

    def interrupt(what: str, _share: float) -> None:
        if what == "warming up":
            assert alive(started[0].pid)
            raise KeyboardInterrupt

    monkeypatch.setattr(Child, "ask", noted)
    with pytest.raises(KeyboardInterrupt):
        measure(Bench(site, tiny, 1, interrupt))
    assert not alive(started[0].pid)


async def test_our_way_gives_both_prompts_for_every_mission(site: Site) -> None:
    mission = bench_missions(site.world)[1]
    agent = next(name for name, spec in site.world.assets.items() if spec.post not in mission.text)
    engine = ScriptedEngine([plan((agent, "report"))])
    pair = await OurWay(site, engine.engine()).run(mission)
    assert mission.text in pair.planner.user
    assert f"{agent} report" in pair.judge.user
    assert pair.usable == 2
    assert pair.seconds >= pair.planning_s + pair.judging_s
    assert engine.warmed == []


async def test_our_way_can_have_the_picture_read_before(site: Site) -> None:
    engine = ScriptedEngine([plan(("Drone_T04", "report"))], [SHORT_VERDICT])
    engine.model = replace(engine.model, prompts="compact")
    ours, mission = OurWay(site, engine.engine()), bench_missions(site.world)[0]
    pair = await ours.run(mission, read_ahead=True)
    for role, prompt in (("planner", pair.planner), ("judge", pair.judge)):
        [(system, user)] = [warmed[1:] for warmed in engine.warmed if warmed[0] == role]
        assert prompt.system == system
        assert prompt.user.startswith(user)
        assert all(gate in user for gate in site.world.gates)
    assert pair.usable == 2
    await ours.ask_the_rest(mission)
    roles = [request.role for request in engine.requests]
    assert roles == ["planner", "judge", "judge", "outcome", "outcome"]


@pytest.mark.parametrize("answer", ["no plan at all", plan(*[("Nobody", "hold")] * 2)])
async def test_a_mission_without_a_sound_plan_still_costs_a_verdict(
    site: Site, answer: str
) -> None:
    engine = ScriptedEngine([answer])
    pair = await OurWay(site, engine.engine()).run(bench_missions(site.world)[0])
    assert [request.role for request in engine.requests] == ["planner", "judge"]
    assert "report" in pair.judge.user


async def test_rounds_become_a_line_a_mission_and_one_for_each_call(site: Site) -> None:
    missions = bench_missions(site.world)
    text = plan(("Drone_T04", "report"))
    ours = OurWay(site, ScriptedEngine([text]).engine())
    pairs = [await ours.run(mission) for mission in missions]
    slower = [replace(pair, seconds=pair.seconds + 1.0) for pair in pairs]
    answers = [
        PlainAnswer(text=words, prompt_tokens=9, completion_tokens=5, complete=True, seconds=2.0)
        for words in (text, "cut off")
    ]
    rounds = [
        [
            Round(m.text, pair, unread, answers[0], answers[1])
            for m, pair, unread in zip(missions, pairs, slower, strict=True)
        ]
    ] * 3
    lines = mission_comparisons(Measured(rounds, Memory(100.0, 150.0), Memory(300.0, 310.0)))
    assert len(lines) == len(missions) + 5
    assert all(line.ratio is not None for line in lines)
    ahead, unread, *_, memory = lines[len(missions) :]
    assert ahead.other is not None
    assert (ahead.other.median, ahead.runs) == (4.0, 3 * len(missions))
    assert unread.ours.median >= 1.0 > ahead.ours.median
    assert "95th percentile: ours" in ahead.note
    assert all("prompt tokens after Enter" in line.note for line in (ahead, unread))
    answers_in_all = 6 * len(missions)
    assert f"plain {answers_in_all // 2} of {answers_in_all}" in ahead.note
    assert (memory.unit, memory.ratio) == ("MB", 3.0)
    assert len(mission_comparisons(Measured(rounds, None, None))) == len(lines) - 1


@pytest.mark.parametrize("roles", [("judge",), ()])
async def test_the_plain_way_has_a_process_for_every_adapter(
    tiny: LocalModel, site: Site, roles: tuple[Role, ...]
) -> None:
    adapters = tuple(adapter for adapter in find_model(None).adapters if adapter.role in roles)
    model = replace(tiny, adapters=adapters, prompts="compact" if roles else "examples", n_ctx=512)
    engine = ScriptedEngine([plan(("Drone_T04", "report"))], [SHORT_VERDICT])
    engine.model = model
    mission = bench_missions(site.world)[0]
    pair = await OurWay(site, engine.engine()).run(mission)
    short = {"system": "Be brief.", "user": "Hold."}
    pair = replace(
        pair,
        planner=pair.planner.model_copy(update=short),
        judge=pair.judge.model_copy(update=short),
    )
    way = await PlainWay(model).start()
    try:
        assert way.memory is not None
        first = await way.answer(mission, pair, 6)
    finally:
        await way.close()
    assert first[0].text.startswith("{")
    assert all(answer.completion_tokens == 6 for answer in first)
    assert way.memory is None


async def test_bare_llama_and_ours_answer_with_the_adapter(tiny: LocalModel) -> None:
    ask = MeasureSpeed(
        system="Talk.", user="Of the river.", grammar="start: /[a-z ]{30}/", max_tokens=30
    )
    adapter = next(item.path for item in find_model(None).adapters if item.role == "planner")
    answers: list[Speed] = []
    for path in ("", str(adapter)):
        child = await Child.start(RAW_MODULE, load(tiny.path).model_copy(update={"adapter": path}))
        try:
            answers.append(await child.ask(ask, Speed))
            bare = ask.model_copy(update={"bare": answers[-1].answer})
            assert (await child.ask(bare, Speed)).answer == answers[-1].answer
        finally:
            await child.close()
    assert answers[0].answer != answers[1].answer


def test_an_answer_of_the_schema_is_a_plan(site: Site) -> None:
    picture = bench_missions(site.world)[0].sim.picture()
    schema = json.loads(plan_schema(site.world, picture))
    action = schema["properties"]["actions"]["items"]["properties"]
    for command in action["command"]["enum"]:
        text = plan((action["agent"]["enum"][0], command))
        assert read_plan(text)[0] is not None, command
