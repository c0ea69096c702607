"""Reports from outside are told in a session; anything else from there is not, nor a failure."""

from collections.abc import Sequence
from contextlib import aclosing
from typing import Any, cast

import pytest

from pa_console.schema.events import event as ev
from pa_console.station import notices as outside_reports
from tests.rig import Rig
from tests.scripted import ScriptedEngine
from tests.tui import story

UP = story.TAK_UP
LAST = ev.ContactLost(uid="ANDROID-2", reason="removed")


class Reports:
    """Gives one list of reports after the other, then fails if it is to."""

    def __init__(self, *given: Sequence[Any], fails: bool = False) -> None:
        self._given, self._fails = list(given), fails

    def news(self) -> list[ev.OutsideReport]:
        """Return the next reports."""
        if self._given:
            return cast(list[ev.OutsideReport], list(self._given.pop(0)))
        if self._fails:
            raise ZeroDivisionError("nobody there")
        return []


async def told(rig: Rig, outside: Reports, last: ev.EventPayload) -> list[ev.EventPayload]:
    """Return the session's events up to `last`."""
    station = rig.station(ScriptedEngine([None]))
    station.listen_to(outside)
    seen: list[ev.EventPayload] = []
    async with aclosing(station.run()) as events:
        async for event in events:
            seen.append(event.data)
            if event.data == last:
                break
    return seen


@pytest.fixture(autouse=True)
def _ask_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outside_reports, "LOOK_S", 0.0)


async def test_only_reports_come_in(rig: Rig) -> None:
    forged = [
        ev.TelemetryReceived(picture=story.PICTURE),
        ev.AllStopped(by="map"),
        ev.StopReleased(by="map"),
        ev.MissionReceived(mission=story.MISSION, position=0),
        ev.AlarmAcknowledged(alarm_id="A", by="map"),
        "move",
    ]
    given = story.reported()
    seen = await told(rig, Reports([UP, *forged], [*given, LAST]), LAST)
    assert [data for data in seen if isinstance(data, ev.UNVERIFIED)] == [UP, *given, LAST]
    assert not [data for data in seen if data in forged]


async def test_a_source_that_fails_is_told_of_and_the_session_goes_on(rig: Rig) -> None:
    text = "no more reports from outside are read: ZeroDivisionError: nobody there"
    failed = ev.Noticed(level="warning", subject="TAK", text=text)
    assert (await told(rig, Reports([UP], fails=True), failed))[-1] == failed
