"""Whatever happens in whatever order, a drone moves only for the newest order that was allowed."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.link import DeviceAnswer
from pa_console.fleets.mavlink.commands import Cmd
from pa_console.fleets.mavlink.geofence import fence_of
from pa_console.schema.command import FINAL_REPLIES
from pa_console.schema.world import World
from tests.fleets.mavlink.scripted import GEOGRAPHY, Rig

FLYING = (Cmd.ARM, Cmd.TAKEOFF, Cmd.REPOSITION, Cmd.START_MISSION, Cmd.RETURN_TO_LAUNCH)
MODES = ("HOLD", "MISSION", "POSCTL", "RETURN_TO_LAUNCH", "OFFBOARD", "LAND", "UNKNOWN")
PILOT = "POSCTL"
VERBS = (("move_to", "NorthGate"), ("move_to", "SouthGate"), ("observe", "EastGate"))

happenings = st.one_of(
    st.tuples(st.just("order"), st.integers(0, 3)),
    st.tuples(st.just("again"), st.integers(0, 20)),
    st.tuples(st.just("hold"), st.integers(0, 2)),
    st.tuples(st.just("ack"), st.sampled_from([int(c) for c in FLYING]), st.integers(0, 6)),
    st.tuples(st.just("held"), st.sampled_from(["", "denied", "timeout"])),
    st.tuples(st.just("uploaded"), st.sampled_from(["", "timeout"])),
    st.tuples(st.just("mode"), st.sampled_from(MODES)),
    st.tuples(st.just("fence"), st.sampled_from(["right", "wrong", "none", "timeout"])),
    st.tuples(st.just("acts"), st.sampled_from(["", "its GF_ACTION is 0"])),
    st.tuples(st.just("arrive"), st.booleans()),
    st.tuples(st.just("ground"), st.booleans()),
    st.tuples(st.just("wait"), st.floats(0.1, 12.0)),
    st.tuples(st.just("reboot"), st.just(0)),
    st.tuples(st.just("text"), st.text(max_size=40)),
)


class History:
    """A flight to which things happen; after each, what must never be is looked for."""

    def __init__(self, world: World, *, flies: bool) -> None:
        self.rig, self.orders, self.stopped, self.newest = Rig(world, flies=flies), 0, True, ""
        self.rig.report()
        self.items = [item for area in fence_of(world, GEOGRAPHY) for item in area.items]
        self.sent = 0
        """The number of commands that were sent before what happens now."""

    def happen(self, what: tuple[object, ...]) -> None:
        """Let one thing happen; raises AssertionError for what must never be."""
        rig, self.sent = self.rig, len(self.rig.autopilot.sent)
        manual = rig.flight.state.manual
        match what:
            case ("order", int(number)):
                self.orders += 1
                name = f"c{self.orders}"
                verb, target = (*VERBS, ("return_to_base", None))[number]
                rig.order(name, verb, target)  # pyright: ignore[reportArgumentType]
                if "refused" not in rig.answers(name):
                    self.stopped, self.newest = False, name
            case ("again", int(number)) if 0 < number <= self.orders:
                rig.order(f"c{number}", "move_to", "NorthGate")
            case ("hold", int(number)):
                rig.order(f"h{number}", "hold")
                self.stopped = self.stopped or not manual
            case ("ack", int(command), int(result)):
                rig.flight.acknowledged(command, result)
            case ("held", str(problem)):
                rig.flight.held(problem, answered=problem != "timeout")
            case ("uploaded", str(problem)):
                rig.flight.uploaded(problem)
            case ("mode", str(mode)):
                rig.flight.mode_changed(mode)
            case ("fence", str(kind)):
                self.fence(kind)
            case ("acts", str(problem)):
                rig.flight.fence.enforced(problem)
            case ("arrive", bool(there)):
                rig.report(rig.flight.place if there else (0.0, 0.0), 20.0)
            case ("ground", bool(on)):
                rig.flight.state.on_ground = on
                rig.flight.heartbeat(1 if on else 129, 4)
            case ("wait", float(seconds)):
                rig.wait(seconds, 0.5, reports=seconds < 6.0)
            case ("reboot", _):
                message = rig.message() | {"time_boot_ms": 10}
                rig.flight.positioned(message, rig.arrival())
            case ("text", str(text)):
                rig.flight.said({"severity": 3, "text": text, "id": 0, "chunk_seq": 0})
            case _:
                pass
        self.look(self.sent, manual)

    def fence(self, kind: str) -> None:
        """Let a fence be read when it is due: the right one, a wrong one, none, or not at all."""
        rig = self.rig
        sent, manual = len(rig.autopilot.sent), rig.flight.state.manual
        rig.now_s += 11.0
        rig.report()
        rig.flight.step()
        self.look(sent, manual)
        self.sent = len(rig.autopilot.sent)
        match kind:
            case "right":
                rig.read_fence(self.items)
            case "wrong":
                rig.read_fence([replace(self.items[0], x=self.items[0].x + 99), *self.items[1:]])
            case "none":
                rig.read_fence(())
            case _:
                rig.flight.fence_read("timeout", ())

    def look(self, sent: int, manual: bool) -> None:
        """Look for what must never be."""
        rig = self.rig
        for command in rig.autopilot.sent[sent:]:
            if command.command in FLYING:
                assert not self.stopped, "nothing flies after a hold without a new order"
                assert not manual, "nothing is sent to a drone that a pilot flies"
                home = command.command == Cmd.RETURN_TO_LAUNCH
                assert not rig.flight.fence.differs or home, "a wrong fence starts no flight"
        fence = rig.flight.fence
        assert not fence.differs or fence.problem, "a wrong fence is never shown as right"
        told: dict[str, list[str]] = {}
        for news in rig.news:
            if isinstance(news, DeviceAnswer):
                told.setdefault(news.command_id, []).append(news.status)
        for name, statuses in told.items():
            finals = [status for status in statuses if status in FINAL_REPLIES]
            assert len(set(finals)) <= 1 or name.startswith("h"), f"{name}: {statuses}"
            assert statuses[0] != "done", "it was taken first"
        assert sum("done" in s for n, s in told.items() if n.startswith("c")) <= self.orders


@given(flies=st.booleans(), what=st.lists(happenings, min_size=5, max_size=40))
@settings(max_examples=200, deadline=None)
def test_nothing_flies_without_a_standing_order(
    world: World, flies: bool, what: list[tuple[object, ...]]
) -> None:
    history = History(world, flies=flies)
    history.fence("right")
    for each in what:
        history.happen(each)


@given(what=st.lists(happenings, min_size=5, max_size=30))
@settings(max_examples=100, deadline=None)
def test_a_move_is_never_done_without_a_position_at_its_place(
    world: World, what: list[tuple[object, ...]]
) -> None:
    history = History(world, flies=True)
    history.fence("right")
    for each in what:
        if each[0] in ("arrive", "ground"):
            continue
        history.happen(each)
    moves = [n for n in history.rig.news if isinstance(n, DeviceAnswer) and n.status == "done"]
    assert not [n for n in moves if n.command_id.startswith("c") and "Gate" in n.detail]


@given(what=st.lists(happenings, max_size=25))
@settings(max_examples=100, deadline=None)
def test_every_order_that_is_replaced_or_stopped_is_answered(
    world: World, what: list[tuple[object, ...]]
) -> None:
    history = History(world, flies=True)
    history.fence("right")
    for each in what:
        history.happen(each)
    history.rig.flight.mode_changed("HOLD")
    history.happen(("hold", 9))
    for number in range(1, history.orders + 1):
        answers = history.rig.answers(f"c{number}")
        assert answers, f"c{number} is lost in silence"
        assert answers[-1] in FINAL_REPLIES


def test_the_histories_do_fly(world: World) -> None:
    history = History(world, flies=False)
    history.fence("right")
    for each in (("order", 0), ("ack", int(Cmd.ARM), 0), ("ack", int(Cmd.TAKEOFF), 0)):
        history.happen(each)
    assert history.rig.autopilot.asked() == [Cmd.ARM, Cmd.TAKEOFF]
    history.fence("wrong")
    assert history.rig.flight.fence.differs
    history.happen(("wait", 0.5))
    assert history.rig.answers("c1")[-1] == "failed"
