"""While the log cannot be written nothing is dispatched and nothing approved; a stop always is."""

import errno
import os
from pathlib import Path

import pytest

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.session.log.chain import LogError
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter
from pa_console.station.station import ControlStation
from tests.rig import Rig, rig, site
from tests.scripted import ScriptedEngine, plan
from tests.session.tamper import KNOWN, MINE

pytestmark = pytest.mark.invariant

__all__ = ["rig", "site"]
FILL = plan(("Drone_T04", "move_to EastGate"))


class Disk:
    """Stands in for os.write: once it is `full`, the system refuses whatever is written."""

    def __init__(self) -> None:
        self.full = False
        self._write = os.write

    def __call__(self, file: int, data: bytes | bytearray | memoryview) -> int:
        """Write, unless there is no room."""
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._write(file, data)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    """Return the disk, which has room."""
    found = Disk()
    monkeypatch.setattr(os, "write", found)
    return found


class Desk:
    """An operator who approves, frees the disk once told that it is full, and approves again."""

    def __init__(self, rig: Rig, log: Path, disk: Disk) -> None:
        self.rig, self.disk, self.refused = rig, disk, list[str]()
        self.told = list[LogError]()
        self.station = rig.station(ScriptedEngine([FILL]))
        self.writer = LogWriter(
            log, self.station.session, signer=MINE, on_error=self.told.append, clock=lambda: 0.0
        )
        self.station.write_to(self.writer)
        self.sent_without_log = 0

    def approve(self) -> None:
        """Approve the plan that waits."""
        self.station.decide(Decision(kind="approve"))

    async def run(self, fills: type[ev.Payload]) -> list[ev.Event]:
        """Let the disk fill up right before the first event of the kind `fills` is logged."""
        append = self.writer.append

        def filling(event: ev.Event, *, commit: bool = True) -> None:
            if isinstance(event.data, fills) and not self.refused and not self.disk.full:
                self.disk.full = True
            if isinstance(event.data, ev.CommandSent):
                self.sent_without_log += self.disk.full
            append(event, commit=commit)

        self.writer.append = filling  # type: ignore[method-assign]
        seen: list[ev.Event] = []
        async for event in self.station.run():
            seen.append(event)
            match event.data:
                case ev.TelemetryReceived() if len(seen) == 2:
                    self.station.submit("Fill the gap at EastGate.")
                case ev.ApprovalRequested():
                    self._decide()
                case ev.MissionFinished():
                    await self.station.close()
                case _:
                    pass
        self.writer.close()
        return seen

    def _decide(self) -> None:
        try:
            self.approve()
        except ValueError as error:
            self.refused.append(str(error))
            self.disk.full = False
            self.approve()


async def test_a_plan_is_not_approved_until_the_log_has_room_again(
    tmp_path: Path, rig: Rig, disk: Disk
) -> None:
    log = tmp_path / "s.jsonl"
    desk = Desk(rig, log, disk)
    seen = await desk.run(ev.ApprovalRequested)
    assert len(desk.refused) == 1
    assert "no approval is possible while the log cannot be written" in desk.refused[0]
    assert "free some space" in desk.refused[0]
    troubles = [bool(e.data.problem) for e in seen if isinstance(e.data, ev.LogTroubled)]
    assert troubles == [True, False]
    assert desk.sent_without_log == 0
    assert any(isinstance(event.data, ev.CommandSent) for event in seen)
    assert verify(log, KNOWN).intact


async def test_an_approval_that_the_log_did_not_take_moves_nobody(
    tmp_path: Path, rig: Rig, disk: Disk
) -> None:
    """The disk fills up with the decision itself: its plan is halted before anything is sent."""
    log = tmp_path / "s.jsonl"
    desk = Desk(rig, log, disk)
    seen = await desk.run(ev.DecisionMade)
    kinds = [event.data.kind for event in seen]
    halted = kinds.index("plan_halted")
    assert "command_sent" not in kinds[:halted]
    assert desk.sent_without_log == 0
    assert desk.refused
    assert verify(log, KNOWN).intact


async def test_a_stop_goes_out_whatever_the_log(tmp_path: Path, rig: Rig, disk: Disk) -> None:
    station: ControlStation = rig.station(ScriptedEngine([FILL]))
    log = tmp_path / "s.jsonl"
    writer = LogWriter(log, station.session, signer=MINE, on_error=lambda _: None)
    station.write_to(writer)
    held: list[str] = []
    seen = 0
    async for event in station.run():
        seen += 1
        if seen == 2:
            disk.full = True
            station.stop_all()
        if isinstance(event.data, ev.CommandSent):
            assert (event.data.command.verb, disk.full) == ("hold", True)
            held.append(event.data.command.agent)
            if len(held) == len(station.world.assets):
                disk.full = False
                await station.close()
    assert sorted(held) == sorted(station.world.assets)
    writer.close()
    assert verify(log, KNOWN).intact
