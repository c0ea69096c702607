"""A recorded session runs again to the same telemetry, and a doctored one does not."""

from collections.abc import Callable
from functools import partial

import pytest

from pa_console.evaluation.twin import resimulate
from pa_console.schema.events import event as ev
from pa_console.schema.incident import (
    FailAsset,
    Incident,
    RandomEvents,
    SetBattery,
    SetRadio,
    SpawnTrack,
)
from pa_console.station.assembly import Site
from pa_console.station.station import ControlStation
from tests.benchmarks.twins import repeated_hashes
from tests.evaluation.sessions import IDENTIFY, RECON, WARN, play, scenario
from tests.scripted import ScriptedEngine
from tests.session.story import at, session_started

VAN = SpawnTrack(gate="WestGate", distance_m=60.0)
POOR = SetRadio(latency_s=0.2, jitter_s=0.3, loss=0.3)
SITUATION = scenario((0.0, POOR), (1.0, VAN))

Act = Callable[[ev.Event, ControlStation], None]


def engine() -> ScriptedEngine:
    return ScriptedEngine([RECON, IDENTIFY, WARN])


def once(act: Callable[[ControlStation], None]) -> Act:
    """Return what acts on the station when the first device acknowledges a command."""
    done: list[ev.Event] = []

    def on_event(event: ev.Event, station: ControlStation) -> None:
        acknowledged = (
            isinstance(event.data, ev.CommandReplied) and event.data.reply.status == "acknowledged"
        )
        if acknowledged and not done:
            done.append(event)
            act(station)

    return on_event


async def test_a_session_over_a_poor_radio_comes_out_equal(site: Site) -> None:
    events = await play(site, engine(), SITUATION, seed=3)
    assert any(isinstance(event.data, ev.CommandResent) for event in events)
    twin = resimulate(events, site.world, SITUATION)
    assert twin.equal, twin.first_difference
    assert twin.pictures == sum(event.data.kind == "telemetry" for event in events)
    assert twin.recorded_sha256 == twin.repeated_sha256


@pytest.mark.parametrize(
    "act",
    [
        ControlStation.cancel,
        ControlStation.stop_all,
        partial(ControlStation.inject, incident=FailAsset(asset="Drone_T04")),
        partial(ControlStation.inject, incident=SetBattery(asset="Drone_T04", percent=12.0)),
    ],
    ids=["cancel", "stop", "failure", "battery"],
)
async def test_what_the_operator_did_meanwhile_is_repeated_too(
    site: Site, act: Callable[[ControlStation], None]
) -> None:
    events = await play(site, engine(), SITUATION, seed=1, on_event=once(act))
    twin = resimulate(events, site.world, SITUATION)
    assert twin.equal, twin.first_difference


async def test_a_command_that_was_tampered_with_shows(site: Site) -> None:
    events = await play(site, engine(), SITUATION)
    number, sent = next(
        (number, event.data)
        for number, event in enumerate(events)
        if isinstance(event.data, ev.CommandSent)
    )
    other = sent.command.model_copy(update={"target": "EastGate"})
    forged = events[number].model_copy(update={"data": ev.CommandSent(command=other)})
    twin = resimulate([*events[:number], forged, *events[number + 1 :]], site.world, SITUATION)
    assert not twin.equal
    assert 0 < twin.different < twin.pictures
    assert "Drone_T04" in twin.first_difference
    assert twin.recorded_sha256 != twin.repeated_sha256


@pytest.mark.parametrize("change", ["seed", "scenario"])
async def test_another_seed_or_situation_shows(site: Site, change: str) -> None:
    events = await play(site, engine(), SITUATION)
    started = events[0].data
    assert isinstance(started, ev.SessionStarted)
    if change == "seed":
        other = started.model_copy(update={"seed": started.seed + 1})
        events[0] = events[0].model_copy(update={"data": other})
    twin = resimulate(events, site.world, SITUATION if change == "seed" else None)
    assert twin.different
    assert twin.first_difference.startswith("tick ")


def test_events_without_a_start_are_refused_and_without_telemetry_prove_nothing(site: Site) -> None:
    with pytest.raises(ValueError, match="start of a session"):
        resimulate([at(0.0, ev.AllStopped(by="x"))], site.world)
    assert not resimulate([at(0.0, session_started())], site.world).equal


@pytest.mark.parametrize("seed", [0, 1])
def test_stepped_and_forked_give_equal_hashes(site: Site, seed: int) -> None:
    drawn: tuple[Incident, ...] = (VAN, SetBattery(asset="Drone_T01", percent=30.0))
    played = SITUATION.model_copy(update={"random": (RandomEvents(mean_s=10.0, do=drawn),)})
    one, forked = repeated_hashes(site.world, played, seed)
    assert one == forked
    assert one != repeated_hashes(site.world, played, seed + 5)[0]
