"""A session is shown in a thread of its own: it is never waited for, and its faults stay there."""

from collections.abc import Callable
from datetime import UTC, datetime
from queue import SimpleQueue
from threading import Event as Flag

from pa_console.schema.events.event import Event, Noticed, SessionEnded, TelemetryReceived
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.tak.session_on_map import InBackground

LIMIT_S = 300.0


def pictures(world: World) -> Callable[[int], Event]:
    picture = Checkpoint(world, seed=1).picture()

    def of(tick: int) -> Event:
        data = TelemetryReceived(picture=picture.model_copy(update={"tick": tick}))
        return Event(t=datetime.now(UTC), tick=tick, data=data)

    return of


def test_of_the_pictures_that_wait_only_the_newest_is_shown(world: World) -> None:
    of, begun, go_on = pictures(world), Flag(), Flag()
    shown: list[Event] = []

    def show(event: Event) -> None:
        begun.set()
        assert go_on.wait(LIMIT_S)
        shown.append(event)

    told: list[str] = []
    with InBackground(show, told.append) as background:
        background.take(of(1))
        assert begun.wait(LIMIT_S)
        for tick in range(2, 100):
            background.take(of(tick))
        notice = Noticed(level="info", subject="s", text="t")
        background.take(Event(t=datetime.now(UTC), tick=99, data=notice))
        background.take(Event(t=datetime.now(UTC), tick=99, data=SessionEnded(reason="over")))
        go_on.set()
    kinds = [(event.tick, event.data.kind) for event in shown]
    assert kinds == [(1, "telemetry"), (99, "telemetry"), (99, "session_ended")]
    assert not told


def test_a_fault_is_told_once_and_reaches_no_session(world: World) -> None:
    of = pictures(world)
    told: SimpleQueue[str] = SimpleQueue()

    def show(event: Event) -> None:
        raise ZeroDivisionError(f"picture {event.tick}")

    with InBackground(show, told.put) as background:
        background.take(of(1))
        assert told.get(timeout=LIMIT_S) == "nothing more is shown: ZeroDivisionError: picture 1"
        for tick in range(2, 10):
            background.take(of(tick))
    assert told.empty()
