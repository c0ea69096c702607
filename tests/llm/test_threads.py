"""The model computes on the cores that nobody else uses, whatever the others do."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.llm.local.runtime import Runtime
from pa_console.llm.local.threads import FreeCores
from pa_console.llm.models.catalogue import LocalModel

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

TOKEN_S = 0.020
"""One token on one core of the machine below."""


class Machine:
    """Cores that others keep busy; a thread that has to share its core stops all the others.

    Without `tells` it does not say how long its cores were idle.
    """

    def __init__(self, cores: int, busy: int = 0, *, tells: bool = True) -> None:
        self.cores, self.busy, self._tells = cores, busy, tells
        self.now: float = 0.0
        self.computed: float = 0.0
        self.idle: float = 0.0
        self.free_cores = FreeCores(
            cores, now=lambda: self.now, computed=lambda: self.computed, idle=self._told
        )

    def _told(self) -> float | None:
        return self.idle if self._tells else None

    def evaluate(self, count: int = 1) -> list[int]:
        """Evaluate one token after the other; return how many threads each had."""
        return [self._evaluate() for _ in range(count)]

    def _evaluate(self) -> int:
        with self.free_cores.evaluating(1) as threads:
            shared = max(0, threads + min(self.busy, self.cores) - self.cores)
            seconds = TOKEN_S / threads * (1 + shared)
            self.now += seconds
            self.computed += seconds * threads / (1 + shared)
            self.idle += seconds * max(0, self.cores - threads - self.busy)
        return threads

    def rest(self, seconds: float) -> None:
        """Let time pass in which nothing is evaluated."""
        self.now += seconds
        self.idle += seconds * max(0, self.cores - self.busy)


@pytest.mark.parametrize("tells", [True, False])
def test_an_idle_machine_s_cores_are_all_used(tells: bool) -> None:
    assert set(Machine(2, tells=tells).evaluate(500)) == {2}


@pytest.mark.parametrize("tells", [True, False])
@pytest.mark.parametrize("busy", [1, 2, 4])
def test_beside_busy_processes_one_core_is_used_nearly_always(busy: int, tells: bool) -> None:
    machine = Machine(2, busy, tells=tells)
    machine.evaluate(50)
    used = machine.evaluate(2000)
    assert used.count(1) >= 0.98 * len(used)


@given(
    st.sampled_from([True, False]),
    st.lists(st.tuples(st.integers(0, 12), st.integers(0, 40), st.floats(0.0, 3.0)), max_size=12),
)
def test_after_any_history_the_cores_are_used_again_once_they_are_free(
    tells: bool, history: list[tuple[int, int, float]]
) -> None:
    machine = Machine(8, tells=tells)
    for machine.busy, count, pause in history:
        assert set(machine.evaluate(count)) <= set(range(1, 9))
        machine.rest(pause)
    machine.busy = 0
    machine.rest(11.0)
    machine.evaluate(200)
    assert set(machine.evaluate(20)) == {4}  # half of eight saturate the memory


@pytest.mark.parametrize(("busy", "threads"), [(0, 4), (3, 4), (5, 3), (7, 1)])
def test_cores_that_others_leave_are_used(busy: int, threads: int) -> None:
    machine = Machine(8, busy)
    machine.evaluate(50)
    assert machine.evaluate()[0] == threads


def test_it_is_told_when_other_work_made_answers_slow() -> None:
    machine = Machine(2)
    machine.evaluate(100)
    assert not machine.free_cores.busy()
    machine.busy = 1
    machine.evaluate(100)
    assert machine.free_cores.busy()
    machine.busy = 0
    machine.rest(1.0)
    machine.evaluate(100)
    assert not machine.free_cores.busy()


def test_a_fixed_number_stays() -> None:
    machine = Machine(2, busy=4)
    machine.free_cores = FreeCores(2, fixed=True, now=lambda: machine.now)
    assert set(machine.evaluate(200)) == {2}


def test_what_is_answered_does_not_depend_on_the_number_of_threads(
    shallow_model: LocalModel,
) -> None:
    text = "The drone flies to the gate in the east, and the guard waits there. " * 60

    def logits(threads: int) -> list[bytes]:
        cores = FreeCores(threads, fixed=True)
        model = Runtime(str(shallow_model.path), n_ctx=1024, cores=cores, stopped=lambda: False)
        tokens = model.tokenise(text, special=False)[:600]
        first, _ = model.begin(0, tokens)
        found = [first.tobytes()]
        for place, token in enumerate(tokens[:4]):
            found.append(model.extend(0, len(tokens) + place, [token]).tobytes())
        found.append(model.extend(0, len(tokens) + 4, tokens[:9]).tobytes())
        return found

    assert logits(1) == logits(2) == logits(3)


def test_a_context_that_grows_answers_as_one_that_was_large(shallow_model: LocalModel) -> None:
    text = "The drone flies to the gate in the east, and the guard waits there. " * 120

    def logits(before: int) -> list[bytes]:
        """Read a prompt of `before` tokens before the one that is asked about."""
        model = Runtime(
            str(shallow_model.path),
            n_ctx=2048,
            cores=FreeCores(1, fixed=True),
            stopped=lambda: False,
        )
        tokens = model.tokenise(text, special=False)
        model.begin(0, tokens[100 : 100 + before])
        begun, kept = model.begin(0, tokens[:450])
        assert kept == 0
        read = begun.tobytes()
        parts = [(at, tokens[at : at + 20]) for at in range(450, 590, 20)]
        found = [model.extend(0, at, part).tobytes() for at, part in parts]
        again, kept = model.begin(0, tokens[:451])
        return [read, *found, again.tobytes(), str(kept).encode()]

    assert logits(before=20) == logits(before=1200)
