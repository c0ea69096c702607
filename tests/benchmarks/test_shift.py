"""The benchmark `shift`: it works a shift, and counts what no alert has told of."""

from pathlib import Path

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.schema.events.event import Event
from pa_console.schema.incident import FailAsset
from pa_console.session.state import SessionState
from pa_console.station.alarms.alerts import AlertRules, Message
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from tests.benchmarks.shift import TOLD_WITHIN_S, Watch, work_shift
from tests.scripted import ScriptedEngine, plan

HOLD = plan(("Drone_T04", "hold"))


class NobodyTold(AlertRules):
    """Alerts that never come."""

    def due(self, now_s: float) -> list[Message]:
        """Return nothing."""
        return []


async def test_a_short_shift_comes_to_its_end_with_a_sound_log(site: Site, tmp_path: Path) -> None:
    report = await work_shift(
        site, ScriptedEngine([HOLD]).engine(), hours=0.05, seed=1, answer_s=20.0, away_h=0.0,
        folder=tmp_path, tell=lambda _text, _share: None,
    )  # fmt: skip
    assert (report.log_problem, report.flat, report.gaps) == ("", (), ())
    assert report.asked == 1, "the low-battery policy was offered"
    assert len(report.memory_mb) == 8
    assert 80.0 < report.least_battery["Drone_T01"] < 100.0


async def test_a_gate_whose_guard_has_failed_is_a_gap_and_the_alert_is_timed(site: Site) -> None:
    fleet = SimulatedFleet.start(site.world)
    engine = ScriptedEngine([HOLD]).engine()
    station = open_station(site, engine, SteppedClock(), fleet=fleet)
    grace_s = site.world.coverage_grace_s
    told, silent = Watch(grace_s), Watch(grace_s, NobodyTold("high", 0.0))

    def sink(event: Event, state: SessionState) -> None:
        for watch in (told, silent):
            watch.take(event, state, fleet)

    failed = [FailAsset(asset="Drone_T01")]
    await run_missions(station, ["Drone_T04 hold."], lambda r: r.approved(), sink, failed, 60.0)
    for watch in (told, silent):
        watch.close(fleet.time_s)
    assert [gap.gate for gap in told.gaps] == ["WestGate"]
    assert told.gaps[0].told_after_s is not None
    assert told.gaps[0].told_after_s <= grace_s + TOLD_WITHIN_S
    assert [gap.told_after_s for gap in silent.gaps] == [None]
