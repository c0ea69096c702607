"""A session's own tasks: a defect is told, and stopping leaves nothing behind."""

import asyncio

import pytest

from pa_console.station.worker import Background


async def test_the_error_of_a_task_is_told_and_those_that_end_well_are_not() -> None:
    told: list[BaseException] = []
    background = Background(told.append)

    async def fine() -> None:
        return

    async def broken() -> None:
        raise ValueError("a defect")

    await asyncio.wait([background.start(fine()), background.start(broken())])
    assert [str(error) for error in told] == ["a defect"]
    await background.stop()


async def test_stopping_waits_until_every_task_has_tidied_up() -> None:
    told: list[BaseException] = []
    background, tidied = Background(told.append), list[str]()

    async def work(name: str, fails: bool) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            tidied.append(name)
            if fails:
                raise RuntimeError("while tidying up")

    tasks = [background.start(work("a", False)), background.start(work("b", True))]
    await asyncio.wait(tasks, timeout=0)
    await background.stop()
    assert sorted(tidied) == ["a", "b"]
    assert all(task.done() for task in tasks)
    assert [str(error) for error in told] == ["while tidying up"]
    await background.stop()


async def test_a_task_that_was_cancelled_is_no_failure() -> None:
    background = Background(lambda error: pytest.fail(str(error)))
    task = background.start(asyncio.sleep(3600))
    task.cancel()
    await asyncio.wait([task])
    await background.stop()


async def test_who_is_cancelled_while_stopping_stays_cancelled() -> None:
    background = Background(lambda _: None)
    tidying = asyncio.Event()

    async def slow() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            tidying.set()
            await asyncio.Event().wait()

    tasks = [background.start(slow())]
    await asyncio.wait(tasks, timeout=0)
    stopping = asyncio.create_task(background.stop())
    await tidying.wait()
    stopping.cancel()
    await asyncio.wait([stopping, *tasks])
    assert stopping.cancelled()
