"""The engine: streaming, cancel, deadline, a worker that dies, no trace left.

What a model says does not matter to most tests: they ask one of two layers. Others ask a whole one.
"""

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import pytest
import pytest_asyncio

from pa_console.llm.backend import (
    EngineDiedError,
    GenerationEnd,
    ModelError,
    ModelUnavailableError,
    PromptRefusedError,
    Request,
)
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import Catalog, LocalModel
from pa_console.llm.roles.grammar import judge_grammar, plan_grammar
from pa_console.llm.roles.planner import Planner
from pa_console.llm.roles.prompts import planner_prompt
from pa_console.schema.events.event import WorkerState
from pa_console.schema.plan import Plan
from tests.llm.asking import answer
from tests.llm.site import DIGEST, RULE, WORLD, mission, picture

# A busy machine takes minutes to load models; only the requests' own deadlines are tested.
pytestmark = [
    pytest.mark.asyncio(loop_scope="module"),
    pytest.mark.long,
    pytest.mark.timeout(1200),
]

ENDLESS = "start: /[a-z ]{6000,9000}/"
SHORT = Request(
    role="judge",
    system="You are a judge. " * 20,
    user="Is the gate covered?",
    grammar=judge_grammar(["WF-03"]),
    max_tokens=200,
    deadline_s=600,
)
BRIEF = replace(SHORT, grammar="start: /[A-Za-z ,.]{40,50}/", max_tokens=60)
LONG = replace(SHORT, grammar=ENDLESS, max_tokens=2500)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def engine(shallow_model: LocalModel) -> AsyncGenerator[Engine]:
    engine = Engine(shallow_model)
    await engine.start()
    yield engine
    await engine.close()


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def whole(smallest_model: LocalModel) -> AsyncGenerator[Engine]:
    """An engine of a model that speaks, for what depends on its words."""
    engine = Engine(smallest_model)
    yield engine
    await engine.close()


def gone(pid: int) -> bool:
    """Return whether process `pid` has ended and was reaped."""
    return not Path(f"/proc/{pid}").exists()


def worker_pid(engine: Engine) -> int:
    pid = engine.pid
    assert pid is not None
    return pid


async def test_who_listens_only_after_the_start_is_told_how_far_the_model_is(
    smallest_model: LocalModel,
):
    engine, told, ready = Engine(smallest_model), list[str](), asyncio.Event()

    def on_state(state: WorkerState, _detail: str) -> None:
        told.append(state)
        if state == "ready":
            ready.set()

    await engine.start()
    engine.on_state = on_state
    await engine.start()
    assert len(told) == 1
    await ready.wait()
    await engine.start()
    await engine.close()
    assert told in (["loading", "ready"], ["ready"])


async def test_an_answer_streams_fits_its_grammar_and_is_counted(engine: Engine):
    done = await answer(engine, replace(SHORT, max_tokens=1500))
    assert done.finish == "stop"
    assert json.loads(done.text)["rules"][0]["id"] == "WF-03"
    usage = done.usage
    assert 0 < usage.sampled_tokens < usage.completion_tokens
    assert 0 <= usage.guessed_tokens <= usage.sampled_tokens
    assert 0 < usage.first_token_s < usage.seconds
    assert engine.state in ("ready", "slow")
    assert engine.info.n_ctx == 4096


async def test_weights_that_are_copied_are_not_mapped_as_well(engine: Engine, whole: Engine):
    """Few layers leave the shallow model quantised embeddings for the most part."""
    await whole.start()
    for one, mapped in ((engine, False), (whole, True)):
        await answer(one, BRIEF)
        maps = Path(f"/proc/{worker_pid(one)}/maps").read_text(encoding="utf-8")
        assert (one.model.path.name in maps) is mapped


async def test_what_repeats_the_prompt_is_guessed_and_counted(whole: Engine):
    words = "north gate, south gate, east gate, west gate, " * 6
    request = replace(SHORT, user=f"Repeat: {words}", grammar="start: /[a-z, ]{120}/")
    usage = (await answer(whole, replace(request, max_tokens=80))).usage
    assert 10 < usage.guessed_tokens < usage.sampled_tokens <= usage.completion_tokens


async def test_a_hint_saves_steps_and_changes_no_word(engine: Engine):
    request = replace(BRIEF, user="Say what you think of the river gate.")
    unaided = await answer(engine, request)
    hinted = await answer(engine, replace(request, hint=unaided.text))
    assert hinted.text == unaided.text
    assert hinted.usage.guessed_tokens > unaided.usage.guessed_tokens
    misled = await answer(engine, replace(request, hint="seven bananas, " * 8))
    assert misled.text == unaided.text


async def test_an_answer_goes_on_without_reading_again_what_was_read(engine: Engine):
    request = replace(BRIEF, user="Is the hill gate covered?", grammar="start: /[a-z]{3,9}; so: /")
    begun = await answer(engine, request)
    whole = f'start: /{begun.text}(the gate is covered|nobody is there)/ ", I say."'
    going_on = replace(request, grammar=whole, begun=begun.text)
    first = await answer(engine, going_on)
    assert first.finish == "stop"
    assert first.text.startswith(begun.text)
    assert first.usage.cached_tokens == first.usage.prompt_tokens
    anew = await answer(engine, going_on)
    assert anew.text == first.text
    assert anew.usage.cached_tokens < anew.usage.prompt_tokens


async def test_an_answer_that_begins_otherwise_is_written_from_the_start(engine: Engine):
    request = replace(BRIEF, user="Is the hill gate covered?", grammar="start: /[a-z]{3,9}; so: /")
    begun = await answer(engine, request)
    other = replace(request, grammar='start: "<" /[a-z]{4}/ ">"', begun=begun.text)
    done = await answer(engine, other)
    assert (done.finish, done.text[0], done.text[-1]) == ("stop", "<", ">")


async def test_several_answers_are_other_ones_and_begin_as_the_first_where_wanted(
    whole: Engine,
):
    grammar = "start: /[a-z]{3,9}; so: [a-z]{4,12}/"
    request = replace(BRIEF, user="Name a gate.", grammar=grammar)
    first = await answer(whole, request)
    begun = first.text[: first.text.index("so") + 2]
    alike = await answer(whole, replace(request, count=6, begun=begun))
    assert len({first.text, *alike.texts}) == 7
    assert all(text.startswith(begun) for text in alike.texts)
    free = await answer(whole, replace(request, count=6))
    assert len({first.text, *free.texts}) == 7
    assert not all(text.startswith(begun) for text in free.texts)


async def test_a_second_prompt_is_answered_as_in_a_fresh_context(
    engine: Engine, shallow_model: LocalModel
):
    await compare_with_fresh_context(engine, shallow_model)


@pytest.mark.parametrize("name", ["gemma-3-270m", "qwen2.5-coder-0.5b"])
async def test_other_models_too_answer_as_in_a_fresh_context(name: str):
    try:
        model = Catalog.load().locate(name)
    except ModelError:
        pytest.skip(f"{name} was not pulled")
    engine = Engine(model)
    try:
        await compare_with_fresh_context(engine, model)
    finally:
        await engine.close()


async def compare_with_fresh_context(engine: Engine, model: LocalModel) -> None:
    """Ask two prompts that share a beginning, in both roles, and one of them of a new engine."""
    first = replace(BRIEF, user="A truck waits at the river gate. Say what you think of it.")
    second = replace(BRIEF, user="A truck waits at the hill gate. Say what you think of it.")
    for request in (first, replace(first, role="planner"), second, first, second):
        used = await answer(engine, request)
    assert used.usage.cached_tokens > 0
    fresh_engine = Engine(model)
    try:
        fresh = await answer(fresh_engine, second)
    finally:
        await fresh_engine.close()
    assert fresh.usage.cached_tokens == 0
    assert used.text == fresh.text


async def test_a_planner_prompt_gives_a_plan_whatever_the_model_thinks(engine: Engine):
    prompt = planner_prompt(WORLD, DIGEST, [RULE], mission("Watch the hill gate."))
    pieces: list[str] = []
    grammar = plan_grammar(WORLD, picture())
    proposal = await Planner(engine).plan(prompt, grammar, pieces.append)
    assert isinstance(proposal.plan, Plan), proposal.error
    assert "".join(pieces) == proposal.text


async def test_cancel_ends_the_answer_and_keeps_the_worker(engine: Engine):
    pid = worker_pid(engine)
    async with aclosing(engine.generate(LONG)) as items:
        async for item in items:
            if isinstance(item, GenerationEnd):
                assert item.finish == "cancelled"
                assert len(item.text) < 6000
            else:
                engine.cancel()
    assert (await answer(engine, BRIEF)).finish == "stop"
    assert worker_pid(engine) == pid


async def test_cancel_while_the_prompt_is_read_ends_it(engine: Engine):
    reading = asyncio.create_task(answer(engine, replace(BRIEF, user="word " * 3500)))
    await asyncio.sleep(0)
    while not engine.busy:
        await asyncio.sleep(0)
    engine.cancel()
    done = await reading
    assert (done.finish, done.text) == ("cancelled", "")


async def test_an_answer_that_is_late_ends_at_the_deadline(engine: Engine):
    done = await answer(engine, replace(LONG, deadline_s=0.2))
    assert done.finish == "deadline"
    assert (await answer(engine, BRIEF)).finish == "stop"


async def test_a_worker_that_does_not_stop_is_killed_and_replaced(engine: Engine):
    pid = worker_pid(engine)
    os.kill(pid, signal.SIGSTOP)
    done = await answer(engine, replace(BRIEF, deadline_s=0.1))
    assert done.finish == "deadline"
    assert gone(pid)
    assert (await answer(engine, BRIEF)).finish == "stop"
    assert worker_pid(engine) != pid


async def test_an_answer_that_is_too_long_is_cut_off(engine: Engine):
    done = await answer(engine, replace(LONG, max_tokens=7))
    assert done.finish == "length"
    assert done.usage.completion_tokens == 7


async def test_what_was_warmed_up_is_not_read_again(shallow_model: LocalModel):
    engine = Engine(shallow_model)
    try:
        await engine.warm("judge", BRIEF.system)
        assert (await answer(engine, BRIEF)).usage.cached_tokens >= 64
    finally:
        await engine.close()


async def test_a_prompt_interrupts_a_warm_up(engine: Engine):
    warming = asyncio.create_task(engine.warm("planner", "word " * 3500))
    while not engine.busy:
        await asyncio.sleep(0)
    done = await answer(engine, BRIEF)
    await warming
    assert done.finish == "stop"
    rest = await answer(engine, replace(BRIEF, role="planner", system="word " * 3500))
    assert rest.usage.cached_tokens < rest.usage.prompt_tokens - 128


async def test_a_prompt_interrupts_what_a_second_reader_reads_ahead(shallow_model: LocalModel):
    engine = Engine(replace(shallow_model, second_reader=shallow_model))
    second = engine.second_reader
    assert second is not None
    try:
        warming = asyncio.create_task(second.warm("judge", "word " * 3500))
        while not second.busy:
            await asyncio.sleep(0)
        assert (await answer(engine, BRIEF)).finish == "stop"
        await warming
        rest = await answer(second, replace(BRIEF, system="word " * 3500))
        assert rest.usage.cached_tokens < rest.usage.prompt_tokens - 128
    finally:
        await engine.close()


async def test_an_abandoned_answer_does_not_delay_the_next(engine: Engine):
    async with aclosing(engine.generate(LONG)) as items:
        async for _ in items:
            break
    done = await answer(engine, BRIEF)
    assert done.finish == "stop"


async def test_a_prompt_longer_than_the_context_is_refused(engine: Engine):
    with pytest.raises(PromptRefusedError, match=r"\d+ tokens.* context of 4096"):
        await answer(engine, replace(BRIEF, user="word " * 5000))
    assert (await answer(engine, BRIEF)).finish == "stop"


async def test_a_broken_grammar_is_refused(engine: Engine):
    with pytest.raises(PromptRefusedError, match="grammar is not valid"):
        await answer(engine, replace(SHORT, grammar="start: nothing"))


async def test_a_killed_worker_is_noticed_and_started_again(shallow_model: LocalModel):
    states: list[str] = []
    engine = Engine(shallow_model, lambda state, detail: states.append(state))
    try:
        await answer(engine, BRIEF)
        pid = worker_pid(engine)
        with pytest.raises(EngineDiedError):
            await kill_while_answering(engine, pid)
        assert gone(pid)
        assert (await answer(engine, BRIEF)).finish == "stop"
    finally:
        await engine.close()
    changes = [state for state, _ in groupby("ready" if s == "slow" else s for s in states)]
    assert changes == ["loading", "ready", "dead", "loading", "ready"]


async def kill_while_answering(engine: Engine, pid: int) -> None:
    async with aclosing(engine.generate(LONG)) as items:
        async for _ in items:
            os.kill(pid, signal.SIGKILL)


async def test_closing_leaves_no_process(shallow_model: LocalModel):
    engine = Engine(shallow_model)
    await engine.start()
    pid = worker_pid(engine)
    await engine.close()
    assert gone(pid)
    with pytest.raises(ModelUnavailableError):
        await answer(engine, BRIEF)


async def test_a_file_that_is_no_model_makes_the_engine_unavailable(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    path = tmp_path / "broken.gguf"
    path.write_bytes(b"GGUF but not really")
    engine = Engine(LocalModel("broken", path, hash_file(path)))
    with pytest.raises(ModelUnavailableError, match=r"broken\.gguf: not a sound GGUF file"):
        await answer(engine, BRIEF)
    await engine.close()
    assert engine.state == "unavailable"
    assert capfd.readouterr() == ("", "")


PARENT = """\
import asyncio, sys
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.local.engine import Engine
from pathlib import Path
async def main():
    engine = Engine(LocalModel("m", Path(sys.argv[1]), sys.argv[2]))
    await engine.start()
    print(engine.pid, flush=True)
    await asyncio.sleep(60)
asyncio.run(main())
"""


async def test_a_worker_does_not_outlive_its_parent(shallow_model: LocalModel):
    path = os.fspath(shallow_model.path)
    command = [sys.executable, "-c", PARENT, path, shallow_model.sha256]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.kill()
    async with asyncio.timeout(300):
        while not gone(pid) and state_of(pid) != "Z":
            await asyncio.sleep(0.02)


def state_of(pid: int) -> str:
    """Return the letter of the process state; a worker nobody reaps here is a zombie, Z."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return "Z"


async def test_a_prompt_interrupts_an_answer_that_nobody_waits_for(engine: Engine):
    idle = asyncio.create_task(answer(engine, replace(LONG, yields=True)))
    while not engine.busy:
        await asyncio.sleep(0)
    assert (await answer(engine, BRIEF)).finish == "stop"
    assert (await idle).finish == "cancelled"
    assert (await answer(engine, replace(BRIEF, yields=True))).finish == "stop"


async def test_an_answer_that_nobody_waits_for_interrupts_none(engine: Engine):
    urgent = asyncio.create_task(answer(engine, BRIEF))
    while not engine.busy:
        await asyncio.sleep(0)
    idle = asyncio.create_task(answer(engine, replace(BRIEF, yields=True)))
    next_one = asyncio.create_task(answer(engine, replace(BRIEF, user="Say it again.")))
    assert (await urgent).finish == "stop"
    assert (await idle).finish == "cancelled"
    assert (await next_one).finish == "stop"


SLOWED = """\
import json, sys
say = lambda **message: print(json.dumps(message), flush=True)
sys.stdin.readline()
say(op="ready", n_ctx=512, description="a model")
for line in sys.stdin:
    asked = json.loads(line)
    if asked["op"] == "generate":
        slowed = asked["request"]["user"] == "beside others"
        say(op="done", id=asked["id"], finish="stop", usage={}, slowed=slowed)
"""


async def test_the_engine_says_when_answers_are_slow_because_the_machine_is_busy(
    smallest_model: LocalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.llm.local.worker_process.COMMAND", ("-c", SLOWED))
    states: list[tuple[str, str]] = []
    engine = Engine(smallest_model, lambda state, detail: states.append((state, detail)))
    try:
        for user in ("alone", "beside others", "beside others", "alone"):
            await answer(engine, replace(BRIEF, user=user))
    finally:
        await engine.close()
    assert [state for state, _ in states] == ["loading", "ready", "slow", "ready"]
    assert "busy" in states[2][1]
