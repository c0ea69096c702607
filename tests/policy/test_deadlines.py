"""What else the process has to do is not counted as a check's time."""

import gc
import threading
from collections.abc import Generator
from time import thread_time

import pytest

from pa_console.policy.authoring.examples import WORLD
from pa_console.policy.expressions.deadlines import deadline, left_s, shared_deadline, unmeasured
from pa_console.policy.rule_checks import check_mission
from tests.policy.book import checkpoint_rules
from tests.policy.test_checks import MISSION


@pytest.fixture
def collections() -> Generator[list[str]]:
    """The collections of garbage since the test began, with garbage looked for all the time."""
    seen: list[str] = []

    def note(phase: str, _: dict[str, int]) -> None:
        seen.append(phase)

    before = gc.get_threshold()
    gc.callbacks.append(note)
    gc.set_threshold(20, 1, 1)
    yield seen
    gc.set_threshold(*before)
    gc.callbacks.remove(note)


def test_no_garbage_is_looked_for_while_a_check_runs(collections: list[str]) -> None:
    with deadline(60.0):
        collections.clear()
        made = [[number] for number in range(2000)]
        during = list(collections)
    more = [[number] for number in range(2000)]
    assert during == []
    assert collections
    assert len(made) == len(more)


def test_garbage_is_looked_for_again_after_a_check_that_failed() -> None:
    with pytest.raises(ZeroDivisionError), deadline(60.0):
        _ = 1 / 0
    assert gc.isenabled()


def test_where_nobody_looks_for_garbage_nobody_does_afterwards() -> None:
    gc.disable()
    try:
        with deadline(60.0):
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_what_is_compiled_once_for_all_checks_is_charged_to_none() -> None:
    with shared_deadline(0.050):
        with deadline(0.050):
            with unmeasured():
                until = thread_time() + 0.060
                while thread_time() < until:
                    pass
            assert left_s(), "the check has its time still"
        with deadline(0.050):
            assert left_s(), "and so have those after it"


def test_the_words_of_an_order_are_decided_beside_a_thread_that_computes() -> None:
    ended = threading.Event()

    def compute() -> None:
        while not ended.is_set():
            sum(range(1000))

    other = threading.Thread(target=compute)
    other.start()
    try:
        found = [check_mission(checkpoint_rules(), MISSION, WORLD) for _ in range(20)]
    finally:
        ended.set()
        other.join()
    assert {one.status for findings in found for one in findings} == {"complies"}
