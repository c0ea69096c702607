"""Links: latency, jitter, loss, outage and jamming, and what the station concludes from them."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.command import CommandReply
from pa_console.schema.incident import FailAsset, JamArea, PlaceAsset, SetComms, SetRadio
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import Radio, World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import finish, order, run


def drone(sim: Checkpoint) -> AssetTelemetry:
    return sim.picture().assets["Drone_T01"]


def ages(sim: Checkpoint, seconds: float) -> list[float]:
    """Return the age of Drone_T01's report in every new picture."""
    found: list[float] = []
    for _ in range(round(seconds / 0.5)):
        run(sim, 0.5)
        found.append(round(sim.time_s - drone(sim).stamp_s, 6))
    return found


@pytest.mark.parametrize(("latency_s", "steps"), [(0.0, 2), (0.05, 2), (0.3, 6), (1.0, 20)])
def test_a_command_and_its_answer_take_the_latency_each(
    sim: Checkpoint, latency_s: float, steps: int
) -> None:
    sim.inject(SetRadio(asset="Drone_T01", latency_s=latency_s, jitter_s=0.0))
    order(sim, "Drone_T01", "hold")
    assert run(sim, (steps - 1) * 0.1) == []
    assert [reply.status for reply in run(sim, 0.1)] == ["acknowledged", "done"]


def test_the_worlds_own_radio_applies_to_everybody(world: World) -> None:
    slow = world.model_copy(update={"radio": Radio(latency_s=0.5, jitter_s=0.0)})
    sim = Checkpoint(slow)
    order(sim, "Ugv_T01", "hold")
    assert run(sim, 0.9) == []
    assert len(run(sim, 0.1)) == 2
    run(sim, 10.0)
    assert {asset.comms for asset in sim.picture().assets.values()} == {"ok"}


def test_reports_take_their_time(sim: Checkpoint) -> None:
    sim.inject(SetRadio(asset="Drone_T01", latency_s=1.0, jitter_s=0.0))
    assert ages(sim, 10.0)[-5:] == [1.2] * 5


@pytest.mark.parametrize("loss", [0.1, 0.3, 0.6])
def test_as_many_reports_are_lost_as_the_radio_says(world: World, loss: float) -> None:
    sim = Checkpoint(world, seed=5)
    sim.inject(SetRadio(asset="Drone_T01", loss=loss))
    arrived = sum(age < 0.5 for age in ages(sim, 500.0))
    assert arrived / 1000 == pytest.approx(1.0 - loss, abs=0.05)


def test_as_many_commands_are_lost_as_the_radio_says(world: World) -> None:
    sim = Checkpoint(world, seed=5)
    sim.inject(SetRadio(asset="Drone_T01", loss=0.3))
    heard = 0
    for number in range(400):
        order(sim, "Drone_T01", "report", command_id=str(number))
        heard += any(reply.status == "done" for reply in run(sim, 0.4))
    assert heard / 400 == pytest.approx(0.7 * 0.7, abs=0.08)


@given(
    latency_s=st.floats(0.0, 1.0),
    jitter_s=st.floats(0.0, 2.0),
    loss=st.floats(0.0, 0.6),
    seed=st.integers(0, 1000),
)
@settings(max_examples=25, deadline=None)
def test_messages_of_one_device_keep_their_order(
    world: World, latency_s: float, jitter_s: float, loss: float, seed: int
) -> None:
    sim = Checkpoint(world, seed)
    sim.inject(SetRadio(latency_s=latency_s, jitter_s=jitter_s, loss=loss))
    replies: list[CommandReply] = []
    for number in range(12):
        order(sim, "Drone_T01", "hold", command_id=f"{number:02d}")
        replies += run(sim, 0.2)
    replies += run(sim, 10.0)
    assert [reply.tick for reply in replies] == sorted(reply.tick for reply in replies)
    ids = [reply.command_id for reply in replies]
    assert ids == sorted(ids)
    assert all(
        (first.status, second.status) == ("acknowledged", "done")
        for first, second in pairwise(replies)
        if first.command_id == second.command_id
    )


def test_a_report_overtaken_by_a_newer_one_is_ignored(sim: Checkpoint) -> None:
    sim.inject(SetRadio(asset="Drone_T01", latency_s=0.0, jitter_s=3.0))
    stamps: list[float] = []
    for _ in range(120):
        run(sim, 0.5)
        stamps.append(drone(sim).stamp_s)
    assert stamps == sorted(stamps)
    assert len(set(stamps)) < 110, "some were overtaken"


@given(times=st.lists(st.integers(1, 8), min_size=1, max_size=6), loss=st.floats(0.0, 0.7))
@settings(max_examples=20, deadline=None)
def test_a_command_sent_again_is_carried_out_once(
    world: World, times: list[int], loss: float
) -> None:
    sim = Checkpoint(world, seed=3)
    sim.inject(SetRadio(asset="Drone_T04", loss=loss))
    replies: list[CommandReply] = []
    for steps in times:
        order(sim, "Drone_T04", "move_to", "EastGate", command_id="same")
        replies += run(sim, steps * 0.1)
    sim.inject(SetRadio(asset="Drone_T04", loss=0.0))
    order(sim, "Drone_T04", "move_to", "EastGate", command_id="same")
    replies += run(sim, 30.0)
    finals = {reply.tick for reply in replies if reply.status == "done"}
    assert len(finals) == 1
    assert not any(reply.status in ("failed", "refused") for reply in replies)


def test_an_outage_is_seen_as_age_then_stale_then_lost(sim: Checkpoint) -> None:
    run(sim, 5.0)
    sim.inject(SetRadio(asset="Drone_T01", up=False))
    said: list[tuple[bool, str, bool]] = []
    for _ in range(14):
        run(sim, 0.5)
        said.append((drone(sim).stale, drone(sim).comms, drone(sim).available))
    assert said[0] == (False, "ok", True), "nobody can know yet"
    assert said[4][0] is False, "2.7 s old"
    assert (said[5][0], said[5][2]) == (True, False), "3.2 s old"
    assert [comms for _, comms, _ in said].index("lost") == 11, "6.2 s old"
    cover = sim.picture().gates["WestGate"]
    assert (cover.covered, cover.unsure) == (False, ("Drone_T01",))
    assert cover.uncovered_s == 4.5, "since the report there went stale"
    sim.inject(SetRadio(asset="Drone_T01"))
    run(sim, 1.0)
    assert (drone(sim).stale, drone(sim).comms, drone(sim).available) == (False, "degraded", True)
    assert sim.picture().gates["WestGate"].covered
    run(sim, 10.0)
    assert drone(sim).comms == "ok"


def test_nothing_is_sent_over_a_link_that_is_down(sim: Checkpoint) -> None:
    run(sim, 1.0)
    observe = order(sim, "Drone_T04", "observe", "EastGate")
    run(sim, 1.0)
    sim.inject(SetComms(asset="Drone_T04", comms="lost"))
    assert run(sim, 9.0) == []
    assert sim.truth().assets["Drone_T04"].at == "EastGate"
    sim.inject(SetComms(asset="Drone_T04", comms="ok"))
    order(sim, "Drone_T04", "observe", "EastGate", command_id=observe)
    assert [reply.status for reply in run(sim, 1.0)] == ["done"], "the last answer is repeated"


def test_a_lossy_or_slow_link_is_found_degraded(world: World) -> None:
    for values in (SetRadio(asset="Drone_T01", loss=0.4), SetRadio(asset="Drone_T01", latency_s=1)):
        sim = Checkpoint(world, seed=2)
        run(sim, 1.0)
        sim.inject(values)
        assert drone(sim).comms == "ok"
        run(sim, 10.0)
        assert (drone(sim).comms, drone(sim).status) == ("degraded", "degraded")
        assert sim.picture().assets["Drone_T02"].comms == "ok"


def test_a_failed_asset_still_says_so_unless_its_link_is_down(sim: Checkpoint) -> None:
    run(sim, 1.0)
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    for name in ("Drone_T01", "Drone_T02"):
        sim.inject(FailAsset(asset=name))
    run(sim, 10.0)
    silent, heard = drone(sim), sim.picture().assets["Drone_T02"]
    assert (silent.status, silent.comms) == ("degraded", "lost")
    assert (heard.status, heard.comms, heard.stale) == ("failed", "ok", False)
    gates = sim.picture().gates
    assert (gates["WestGate"].unsure, gates["NorthGate"].unsure) == (("Drone_T01",), ())


def test_a_jam_silences_who_is_inside_for_its_time(sim: Checkpoint) -> None:
    run(sim, 1.0)
    sim.inject(JamArea(at=sim.world.frames["WestGate"].at, radius_m=12.0, seconds=15.0))
    run(sim, 8.0)
    assert drone(sim).comms == "lost"
    others = [asset.comms for asset in sim.picture().assets.values() if asset.id != "Drone_T01"]
    assert set(others) == {"ok"}
    order(sim, "Drone_T01", "hold")
    assert run(sim, 6.5) == []
    run(sim, 1.0)
    assert drone(sim).available
    order(sim, "Drone_T01", "hold")
    assert len(run(sim, 1.0)) == 2


def test_an_asset_that_enters_a_jam_falls_silent_and_is_heard_when_it_leaves(
    sim: Checkpoint,
) -> None:
    sim.inject(PlaceAsset(asset="Drone_T04", frame="EastGate"))
    sim.inject(JamArea(at=(0.0, 0.0), radius_m=20.0))
    crossing = order(sim, "Drone_T04", "observe", "WestGate")
    silent: list[float] = []
    for _ in range(40):
        run(sim, 0.5)
        asset = sim.picture().assets["Drone_T04"]
        if sim.time_s - asset.stamp_s > 0.5:
            silent.append(sim.truth().assets["Drone_T04"].position[0])
    assert silent
    assert all(abs(x) < 30.0 for x in silent)
    asset = sim.picture().assets["Drone_T04"]
    assert (asset.at, asset.stale, asset.command_id) == ("WestGate", False, None)
    order(sim, "Drone_T04", "observe", "WestGate", command_id=crossing)
    assert run(sim, 1.0)[-1].status == "done"


def test_an_unknown_agent_is_refused_by_the_gateway_whatever_the_radio_does(
    sim: Checkpoint,
) -> None:
    sim.inject(SetRadio(up=False))
    reply = finish(sim, order(sim, "Tank_T99", "hold"), 1.0)[-1]
    assert reply.status == "refused"
    assert "Drone_T01" in reply.detail
