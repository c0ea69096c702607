"""Hole: a STOP moved an asset. After it nothing but holds may leave until it is released."""

import ast
import asyncio
import os
from collections.abc import Callable
from contextlib import aclosing, suppress
from pathlib import Path

import pytest

import pa_console
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.approval import standing_approver
from pa_console.mission.execute import Execution
from pa_console.mission.rehearse import device_commands
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, SetRadio
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.session.log.writer import LogWriter
from pa_console.session.recording import Player
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import exit_code, run_missions
from tests.attacks.stop_trial import RELIEF, LiveClock, Tapped, checkpoint, stops
from tests.scripted import ScriptedEngine, plan

pytestmark = pytest.mark.invariant

STOPS = int(os.environ.get("PA_CONSOLE_STOPS", "150"))
"""So many random missions are stopped; `python -m tests.attacks stop` takes more."""

CHUNKS = 5
REPORT = plan(("Drone_T04", "report"))


@pytest.fixture(scope="module")
def site() -> Site:
    return checkpoint()


class Run:
    """A station on which what is sent is counted at the simulation."""

    def __init__(self, site: Site, *plans: str, respond: bool = False) -> None:
        self.sim = Tapped(site, 1, None)
        self.sent: list[DeviceCommand] = []
        self.sim.on_send = self._send
        self.began: int | None = None
        """The tick of the first command: checks run beside the world, which does not wait."""
        self.station = open_station(
            site,
            ScriptedEngine(plans or [REPORT]).engine(),
            LiveClock(),
            fleet=SimulatedFleet(self.sim),
            respond=respond,
        )
        self.events: list[ev.Event] = []
        self.state = SessionState()
        self.at: dict[int, Callable[[], object]] = {}
        """What is done at which tick."""
        self.under_way: dict[int, Callable[[], object]] = {}
        """What is done so many ticks after the first command."""

    def _send(self, command: DeviceCommand) -> None:
        self.began = self.sim.tick if self.began is None else self.began
        self.sent.append(command)

    def _step(self, now: int) -> None:
        self.at.pop(now, lambda: None)()
        if self.began is not None:
            self.under_way.pop(now - self.began, lambda: None)()

    async def until(self, tick: int, *, under_way: bool = False, sent: str = "") -> None:
        """Run up to `tick`, counted from the first command if asked; approve what may be.

        It ends before where it was waited for that a command is `sent`.
        """
        approve = standing_approver("auto")
        self.sim.on_step = self._step
        async with aclosing(self.station.run()) as events:
            async for event in events:
                self.events.append(event)
                self.state.apply(event)
                if isinstance(event.data, ev.ApprovalRequested):
                    with suppress(ValueError):  # it waits no more
                        self.station.decide(approve(event.data))
                since = self.began if under_way else 0
                if since is not None and self.sim.tick - since >= tick:
                    return
                if sent and sent in self.words():
                    return

    def words(self) -> list[str]:
        """Return what was sent."""
        return [f"{c.agent} {c.verb} {c.target or ''}".strip() for c in self.sent]


@pytest.mark.parametrize("tick", [20, 30, 40, 50])
async def test_a_stop_in_a_relief_sends_eight_holds_and_then_nothing(site: Site, tick: int) -> None:
    run = Run(site, RELIEF)
    run.station.submit("Relieve Drone_T01 by Drone_T04.")
    before: list[str] = []

    def stop() -> None:
        before.extend(run.words())
        run.sent.clear()
        run.station.stop_all()

    run.under_way[tick] = stop
    await run.until(tick + 100, under_way=True)
    assert "Drone_T01 move_to EastGate" in before
    assert run.words() == [f"{name} hold" for name in site.world.assets]
    assert all(asset.speed_mps == 0 for asset in run.sim.truth().assets.values())
    assert run.state.stop is not None


@pytest.mark.parametrize("part", range(CHUNKS))
async def test_whatever_goes_on_a_stop_is_the_last_word(part: int) -> None:
    count = -(-STOPS // CHUNKS)
    tally = await stops(part * count, count)
    assert tally.held > 0
    assert not tally.amiss, tally.summary()


async def test_a_lost_way_to_safety_is_not_sent_again_after_a_stop(site: Site) -> None:
    run = Run(site, RELIEF)
    run.station.submit("Relieve Drone_T01 by Drone_T04.")

    def cancel() -> None:
        run.sim.inject(SetRadio(asset="Drone_T01", up=False))
        run.station.cancel()

    def stop() -> None:
        assert run.words().count("Drone_T01 move_to WestGate") > 1, "it is being sent again"
        run.sent.clear()
        run.station.stop_all()

    back = lambda: run.sim.inject(SetRadio(asset="Drone_T01"))  # noqa: E731
    run.under_way |= {25: cancel, 50: stop, 55: back}
    await run.until(160, under_way=True)
    assert {command.verb for command in run.sent} == {"hold"}


async def test_alarms_raise_no_missions_until_the_stop_is_released(site: Site) -> None:
    run = Run(site, plan(("Drone_T04", "move_to EastGate")), respond=True)
    run.at |= {
        10: run.station.stop_all,
        12: lambda: run.station.inject(FailAsset(asset="Ugv_T01")),
    }
    await run.until(150)
    assert run.state.open_alarms, "the alarm itself is raised"
    assert not run.state.missions
    assert {command.verb for command in run.sent} == {"hold"}


async def test_a_release_is_logged_and_takes_up_the_alarms_that_are_open(
    site: Site, tmp_path: Path
) -> None:
    run = Run(site, plan(("Drone_T04", "move_to EastGate")), respond=True)
    run.at |= {
        10: run.station.stop_all,
        12: lambda: run.station.inject(FailAsset(asset="Ugv_T01")),
        100: lambda: run.station.release("the watch officer"),
    }
    await run.until(20_000, sent="Drone_T04 move_to EastGate")
    kinds = [event.data.kind for event in run.events]
    released = kinds.index("stop_released")
    assert "mission_received" not in kinds[:released]
    assert "mission_received" in kinds[released:]
    assert "Drone_T04 move_to EastGate" in run.words()
    assert run.state.stop is None
    path = tmp_path / "session.jsonl"
    with LogWriter(path, run.station.session) as log:
        for event in run.events:
            log.append(event)
    player = Player.open(path)
    stopped = kinds.index("all_stopped")
    for index, latched in ((stopped, True), (released - 1, True), (released, False)):
        player.to_event(index)
        assert (player.state.stop is not None) == latched
    assert "released by the watch officer" in [n.text for n in player.state.notices]


async def test_no_mission_is_taken_while_stopped_and_the_reason_is_told(site: Site) -> None:
    station = Run(site).station
    with pytest.raises(ValueError, match="nothing is stopped"):
        station.release()
    station.stop_all()
    with pytest.raises(ValueError, match=r"stopped.*released"):
        station.submit("Send Drone_T04 to the East Gate.")
    station.release()
    assert not station.stopped
    assert station.submit("Send Drone_T04 to the East Gate.").id


def test_a_read_only_station_releases_nothing(site: Site) -> None:
    station = open_station(site, ScriptedEngine([REPORT]).engine(), SteppedClock(), readonly=True)
    with pytest.raises(ValueError, match="read-only"):
        station.release()


async def test_the_gate_keeps_back_what_the_console_would_send_after_a_stop(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = Plan(reason="r", actions=(Action(agent="Drone_T01", command="move_to WestGate"),))

    def stubborn(self: Execution) -> tuple[DeviceCommand, ...]:
        return device_commands(home, "M1.halt1")

    monkeypatch.setattr(Execution, "halt", stubborn)
    run = Run(site, RELIEF)
    run.station.submit("Relieve Drone_T01 by Drone_T04.")
    run.at[30] = lambda: (run.sent.clear(), run.station.stop_all())
    await run.until(100)
    assert {command.verb for command in run.sent} == {"hold"}
    [kept] = [e.data for e in run.events if isinstance(e.data, ev.CommandRefused)]
    assert (kept.command.agent, kept.command.target) == ("Drone_T01", "WestGate")
    assert "stopped" in kept.reason
    assert any("move_to WestGate" in notice.text for notice in run.state.notices)


async def test_a_stop_ends_a_headless_run_without_its_other_missions(site: Site) -> None:
    station = open_station(site, ScriptedEngine([RELIEF]).engine(), SteppedClock())

    def sink(event: ev.Event, _: SessionState) -> None:
        if isinstance(event.data, ev.CommandSent) and not station.stopped:
            station.stop_all("the supervisor")

    texts = ["Relieve Drone_T01.", "Send Drone_T04 home.", "Report."]
    async with asyncio.timeout(300):
        traces = await run_missions(station, texts, standing_approver("auto"), sink)
    assert [trace.status for trace in traces] == ["cancelled"]
    assert exit_code([trace.status for trace in traces]) == 3


async def test_a_stop_while_a_plan_waits_for_a_headless_approver_is_no_error(site: Site) -> None:
    station = open_station(site, ScriptedEngine([RELIEF]).engine(), SteppedClock())

    def sink(event: ev.Event, _: SessionState) -> None:
        if isinstance(event.data, ev.ApprovalRequested):
            station.stop_all()

    async with asyncio.timeout(300):
        traces = await run_missions(
            station, ["Send Drone_T04 to the West Gate."], standing_approver("auto"), sink
        )
    assert [trace.status for trace in traces] == ["cancelled"]


def test_nothing_but_the_gate_sends_to_the_fleet() -> None:
    """A rehearsal has a simulation of its own, and so has a session that is played up to now."""
    senders = {
        (path.name, ast.unparse(node.func.value))
        for package in ("mission", "station")
        for path in (Path(pa_console.__file__).parent / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "send"
    }
    to_devices = {(name, what) for name, what in senders if not what.endswith("gate")}
    assert to_devices == {
        ("gate.py", "self._fleet"),
        ("rehearse.py", "forecast"),
        ("unclosed_session.py", "fleet"),
    }


async def test_a_decision_that_comes_too_late_moves_nothing(site: Site) -> None:
    run = Run(site, RELIEF)
    run.station.submit("Relieve Drone_T01 by Drone_T04.")
    async with aclosing(run.station.run()) as events:
        async for event in events:
            if isinstance(event.data, ev.ApprovalRequested):
                run.station.decide(Decision(kind="approve", override_judge=True, reason="r"))
                run.station.stop_all()
            if isinstance(event.data, ev.MissionFinished):
                break
    assert {command.verb for command in run.sent} == {"hold"}
    with pytest.raises(ValueError, match="no plan is waiting"):
        run.station.decide(Decision(kind="approve"))
