"""The judge's verdict on an outcome stands beside the mission, and nobody waits for it."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import aclosing

import pytest

from pa_console.llm.backend import EngineDiedError, GenerationEnd, Request
from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.incident import SpawnTrack
from pa_console.station.assembly import open_station
from pa_console.station.clock import RealTimeClock
from pa_console.station.station import ControlStation
from tests.rig import MISSION, Rig
from tests.scripted import FAILURE, SUCCESS, Answer, ScriptedEngine, plan

SPARE = plan(("Drone_T04", "move_to EastGate"))
HOME = plan(("Drone_T04", "return_to_base"))


class BusyEngine(ScriptedEngine):
    """A model whose first answers about outcomes are cut short, as by a prompt that goes first."""

    def __init__(
        self, *verdicts: Answer, plans: tuple[str, ...] = (SPARE,), cut_short: int = 0
    ) -> None:
        super().__init__(plans, verdicts or (SUCCESS,))
        self.cut_short = cut_short

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Give the next answer."""
        if request.yields and self.cut_short:
            self.cut_short -= 1
            yield GenerationEnd("", Usage(), "cancelled")
            return
        async with aclosing(super().generate(request)) as items:
            async for item in items:
                yield item


def judged(rig: Rig) -> list[ev.OutcomeJudged]:
    """Return what was told of outcomes."""
    return [e.data for e in rig.events if isinstance(e.data, ev.OutcomeJudged)]


async def test_a_mission_ends_by_telemetry_and_its_verdict_follows(rig: Rig) -> None:
    trace = await rig.run(BusyEngine(SUCCESS, FAILURE))
    assert trace.status == "verified"
    assert trace.outcome_verdict is not None
    assert trace.outcome_verdict.verdict == "Failure"
    kinds = rig.kinds()
    ended, told = kinds.index("mission_finished"), kinds.index("outcome_judged")
    assert ended < told < kinds.index("session_ended")
    assert rig.events[told].mission == rig.events[ended].mission
    assert rig.events[told].tick == rig.events[ended].tick  # the world waits for the model


async def test_the_next_mission_goes_before_a_verdict(rig: Rig) -> None:
    station = rig.station(BusyEngine(plans=(SPARE, HOME), cut_short=1))
    first, second = await rig.carry_out(station, [MISSION, "Send the drone home."])
    told = [
        (event.data.kind, event.mission)
        for event in rig.events
        if event.data.kind in ("mission_started", "mission_finished", "outcome_judged")
    ]
    assert told == [
        ("mission_started", first.mission.id),
        ("mission_finished", first.mission.id),
        ("mission_started", second.mission.id),
        ("mission_finished", second.mission.id),
        ("outcome_judged", first.mission.id),
        ("outcome_judged", second.mission.id),
    ]
    assert all(trace.outcome_verdict is not None for trace in (first, second))


@pytest.mark.parametrize("waits", [False, True])
async def test_a_session_that_ends_has_a_word_on_every_outcome(rig: Rig, waits: bool) -> None:
    engine = BusyEngine(cut_short=1)
    station = rig.station(engine)
    closing: asyncio.Task[None] | None = None
    async with aclosing(station.run()) as events:
        async for event in events:
            rig.events.append(event)
            match event.data:
                case ev.TelemetryReceived() if "mission_received" not in rig.kinds():
                    station.submit(MISSION)
                case ev.ApprovalRequested():
                    station.decide(standing_approver("auto")(event.data))
                case ev.MissionFinished():
                    while engine.cut_short:
                        await asyncio.sleep(0)
                    closing = asyncio.create_task(station.close("time to go", judge_outcomes=waits))
                case _:
                    pass
    assert closing is not None
    await closing
    [told] = judged(rig)
    assert (told.verdict is not None) == waits
    assert ("time to go" in told.error) == (not waits)
    assert rig.kinds()[-1] == "session_ended"


async def test_a_mission_that_is_cancelled_while_it_is_watched_says_that_none_comes(
    rig: Rig,
) -> None:
    def cancel(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.MissionVerified):
            station.cancel()

    trace = await rig.run(BusyEngine(), on_event=cancel)
    assert trace.status == "cancelled"
    [told] = judged(rig)
    assert told.verdict is None
    assert "interrupted" in told.error
    assert trace.verified[-1].error == told.error


async def test_a_model_that_fails_does_not_leave_an_outcome_without_a_word(rig: Rig) -> None:
    died = EngineDiedError("the model's process died")
    trace = await rig.run(BusyEngine(SUCCESS, died, died))
    assert trace.status == "verified"
    assert "died" in trace.verified[-1].error


async def test_every_plan_has_its_own_verdict(rig: Rig) -> None:
    """A phase of a workflow does not wait for the verdict on the one before."""
    recon = plan(("Drone_T04", "observe WestGate"))
    identify = plan(("Robot_T01", "identify WestGate"))
    engine = BusyEngine(plans=(recon, identify))
    trace = await rig.run(
        engine, setup=[SpawnTrack(gate="WestGate", distance_m=60.0)], text="Inspect the vehicle."
    )
    assert len(trace.verified) > 1
    assert [v.attempt for v in trace.verified] == [told.attempt for told in judged(rig)]
    assert all(v.judged for v in trace.verified)


async def test_a_verdict_comes_while_the_operator_reads_the_next_plan(rig: Rig) -> None:
    """In a console, where the world goes on; here the operator waits until the verdict is there."""
    recon = plan(("Drone_T04", "observe WestGate"))
    identify = plan(("Robot_T01", "identify WestGate"))
    engine = BusyEngine(plans=(recon, identify)).engine()
    station = open_station(rig.site, engine, RealTimeClock(20.0))
    approve = standing_approver("auto")
    given: asyncio.Task[None] | None = None
    next_plan: ev.ApprovalRequested | None = None

    async def give() -> None:
        station.inject(SpawnTrack(gate="WestGate", distance_m=60.0))
        await station.advance(2.0)
        station.submit("Inspect the vehicle.")

    async with asyncio.timeout(300), aclosing(station.run()) as events:
        async for event in events:
            rig.events.append(event)
            match event.data:
                case ev.TelemetryReceived() if given is None:
                    given = asyncio.create_task(give())
                case ev.ApprovalRequested() if "mission_verified" not in rig.kinds():
                    station.decide(approve(event.data))
                case ev.ApprovalRequested():
                    next_plan = event.data
                case ev.OutcomeJudged() if next_plan is not None:
                    break
                case _:
                    pass
    assert [told.verdict is not None for told in judged(rig)] == [True]
    assert "mission_finished" not in rig.kinds()
