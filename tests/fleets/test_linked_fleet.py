"""Several links make one fleet: one picture, and each command goes to the link of its asset."""

from collections.abc import Sequence
from dataclasses import replace
from math import nan

import pytest

from pa_console.fleets.fleet import MapsGround
from pa_console.fleets.link import DeviceAnswer, GroundMap, LinkNews, LinkNotice
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.reports import ContactReport, SensorReport
from pa_console.mission.gate import CommandGate
from pa_console.mission.stop import EmergencyStop
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.world import Background, World
from pa_console.session.log.journal import Journal
from pa_console.session.state import SessionState
from pa_console.session.wording import links_in_words
from pa_console.terminal import session_lines
from pa_console.tui.screens import compose as card
from tests.fleets.scripted_link import EPOCH, Desk, ScriptedLink

DRONE, UGV, ROBOT = "Drone_T01", "Ugv_T01", "Robot_T01"
ON_AIR, ON_GROUND = "air:1", "ground:2"


@pytest.fixture
def desk(world: World) -> Desk:
    return Desk(world, ScriptedLink(ON_AIR, {DRONE}), ScriptedLink(ON_GROUND, {UGV, ROBOT}))


def command(number: int, agent: str, verb: Verb, target: str | None = None) -> DeviceCommand:
    return DeviceCommand(command_id=f"M1.{number}", agent=agent, verb=verb, target=target)


def test_one_picture_of_all_links_and_those_on_none_were_never_heard(desk: Desk) -> None:
    air, ground = desk.links
    air.news.append(desk.report(DRONE, "NorthGate", task="holding"))
    ground.news.append(desk.report(ROBOT, "EastGate", battery_pct=55.0))
    desk.go(5)
    picture = desk.fleet.picture()
    drone, robot, other = (picture.assets[n] for n in (DRONE, ROBOT, "Drone_T02"))
    assert (drone.at, drone.post, drone.task, drone.available) == (
        "NorthGate",
        "NorthGate",
        "holding",
        True,
    )
    assert (robot.at, robot.battery_pct) == ("EastGate", 55.0)
    assert (other.comms, other.stale, other.available) == ("lost", True, False)
    assert picture.links == {DRONE: ON_AIR, UGV: ON_GROUND, ROBOT: ON_GROUND}
    lines = links_in_words(picture)
    assert lines[0] == f"{ON_AIR}: {DRONE}"
    assert lines[1].startswith(f"{ON_GROUND}: ")
    assert lines[1].endswith(f"; nothing comes from {UGV}")
    assert lines[2].startswith("on no link: ")
    assert "Drone_T02" in lines[2]


def test_the_console_names_the_link_of_each_asset(desk: Desk) -> None:
    air, _ = desk.links
    air.news.append(desk.report(DRONE, "NorthGate"))
    desk.go(5)
    picture = desk.fleet.picture()
    state = SessionState(picture=picture)
    rows = {line.partition(":")[0]: line for line in session_lines.asset_lines(state)}
    assert rows[DRONE].endswith(f"link ok over {ON_AIR}")
    assert rows[UGV].endswith(f"link lost over {ON_GROUND}, telemetry is stale")
    assert "link lost on no link" in rows["Drone_T02"]
    assert f"{ON_AIR}: {DRONE}" in session_lines.status_lines(state)
    shown = [card.asset_lines(picture.assets[name], picture) for name in (DRONE, "Ugv_T02")]
    assert [lines[-1] for lines in shown] == [f"over {ON_AIR}", "on no link"]


def test_a_command_goes_to_the_link_of_its_asset_and_its_answers_come_back(desk: Desk) -> None:
    air, ground = desk.links
    desk.fleet.send(command(1, DRONE, "observe", "EastGate"))
    desk.fleet.send(command(2, ROBOT, "move_to", "WestGate"))
    assert [(c.agent, c.verb, c.target) for c in air.sent] == [(DRONE, "observe", "EastGate")]
    assert [c.agent for c in ground.sent] == [ROBOT]
    assert air.sent[0].command_id != "M1.1", "ids of another session could be the same"
    air.answer("acknowledged")
    ground.answer("refused", "the door is closed")
    air.news.append(
        desk.report(DRONE, "NorthGate", task="moving", command_id=air.sent[0].command_id)
    )
    desk.go(5)
    assert desk.replies == [
        ("M1.1", "acknowledged", ""),
        ("M1.2", "refused", "the door is closed"),
    ]
    drone = desk.fleet.picture().assets[DRONE]
    assert (drone.command_id, drone.at, drone.post) == ("M1.1", "NorthGate", "EastGate")


def test_a_command_that_ended_is_not_sent_again_and_its_answer_is_repeated(desk: Desk) -> None:
    air, _ = desk.links
    go = command(1, DRONE, "move_to", "EastGate")
    for status in ("acknowledged", "done"):
        desk.fleet.send(go)
        air.answer(status)
        desk.go()
    assert [c.command_id for c in air.sent] == [air.sent[0].command_id] * 2
    desk.fleet.send(go)
    desk.go()
    assert len(air.sent) == 2
    assert [status for _, status, _ in desk.replies] == ["acknowledged", "done", "done"]


def test_a_hold_is_sent_as_often_as_it_is_asked_for(desk: Desk) -> None:
    air, _ = desk.links
    hold = command(1, DRONE, "hold")
    for _ in range(3):
        desk.fleet.send(hold)
        air.answer("done")
        desk.go()
    assert len(air.sent) == 3
    assert len(desk.replies) == 3


def test_an_id_that_another_command_has_used_is_refused(desk: Desk) -> None:
    air, _ = desk.links
    desk.fleet.send(command(1, DRONE, "move_to", "EastGate"))
    desk.fleet.send(command(1, DRONE, "move_to", "WestGate"))
    desk.go()
    assert [c.target for c in air.sent] == ["EastGate"]
    assert desk.replies == [("M1.1", "refused", "its id was used for another command before")]


@pytest.mark.parametrize("case", ["unknown id", "own id", "another asset", "another link", "twice"])
def test_an_answer_to_nothing_that_was_asked_changes_nothing(desk: Desk, case: str) -> None:
    air, ground = desk.links
    desk.fleet.send(command(1, DRONE, "move_to", "EastGate"))
    on_wire = air.sent[0].command_id
    match case:
        case "unknown id":
            air.news.append(DeviceAnswer("M9.9", DRONE, "done"))
        case "own id":  # an answer of another session to the same number
            air.news.append(DeviceAnswer("M1.1", DRONE, "done"))
        case "another asset":
            air.news.append(DeviceAnswer(on_wire, ROBOT, "done"))
        case "another link":
            ground.news.append(DeviceAnswer(on_wire, DRONE, "done"))
        case _:
            air.answer("failed", "no way")
            air.answer("done")
    desk.go()
    if case == "twice":
        assert desk.replies == [("M1.1", "failed", "no way")]
    else:
        assert not desk.replies
        assert "not sent to it" in " ".join(notice.text for notice in desk.notices)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"age_s": -60.0}, "ahead of ours"),
        ({"age_s": 5.0}, "older than the one before"),
        ({"position": (nan, 0.0)}, "is not a place"),
        ({"battery_pct": 300.0}, "battery_pct"),
        ({"speed_mps": -1.0}, "speed_mps"),
        ({"task": "attacking"}, "task"),
        ({"agent": "Drone_T02"}, "does not belong"),
        ({"agent": "Nobody"}, "does not belong"),
        ({"sent": "yesterday"}, "set aside"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_a_report_that_cannot_be_believed_is_told_and_changes_nothing(
    desk: Desk, said: dict[str, object], why: str
) -> None:
    air, _ = desk.links
    air.news.append(desk.report(DRONE, "NorthGate"))
    desk.go(10)
    before = desk.fleet.picture().assets
    given: dict[str, object] = {"agent": DRONE, "at": "EastGate", **said}
    sent = given.pop("sent", None)
    report = desk.report(**given)  # pyright: ignore[reportArgumentType]
    air.news.append(replace(report, sent=sent) if sent is not None else report)  # pyright: ignore[reportArgumentType]
    desk.go(5)
    assert desk.fleet.picture().assets == before
    assert why in " ".join(notice.text for notice in desk.notices)


def test_an_asset_that_a_person_steers_gets_holds_only_until_it_is_given_back(desk: Desk) -> None:
    air, _ = desk.links
    air.news.append(desk.report(DRONE, "NorthGate", manual=True))
    desk.go(5)
    shown = desk.fleet.picture().assets[DRONE]
    assert (shown.manual, shown.available) == (True, False)
    assert desk.fleet.picture().gates["NorthGate"].by == (DRONE,), "its position covers the gate"
    desk.fleet.send(command(1, DRONE, "move_to", "EastGate"))
    desk.fleet.send(command(2, DRONE, "hold"))
    desk.go()
    assert desk.replies == [("M1.1", "refused", "it is under manual control")]
    assert [c.verb for c in air.sent] == ["hold"]
    air.news.append(desk.report(DRONE, "NorthGate"))
    desk.go(5)
    assert desk.fleet.picture().assets[DRONE].available
    desk.fleet.send(command(3, DRONE, "move_to", "EastGate"))
    assert air.sent[-1].verb == "move_to"


def test_what_an_operator_has_taken_is_shown_at_once(desk: Desk) -> None:
    air, _ = desk.links
    air.news.append(desk.report(DRONE, "NorthGate"))
    desk.go(5)
    desk.fleet.mark_manual(frozenset((DRONE,)))
    shown = desk.fleet.picture().assets[DRONE]
    assert (shown.manual, shown.available) == (True, False)
    desk.fleet.mark_manual(frozenset())
    assert desk.fleet.picture().assets[DRONE].available


def test_a_link_that_breaks_is_an_alarm_and_its_assets_are_lost_at_once(desk: Desk) -> None:
    air, ground = desk.links
    air.news.append(desk.report(DRONE, "NorthGate"))
    ground.news.append(desk.report(ROBOT, "EastGate"))
    desk.go(5)
    air.problem = "the cable is out"
    desk.fleet.send(command(1, DRONE, "move_to", "EastGate"))
    desk.go(5)
    assets = desk.fleet.picture().assets
    assert (assets[DRONE].comms, assets[DRONE].available) == ("lost", False)
    assert assets[ROBOT].available
    assert not air.sent
    assert desk.told(ON_AIR) == ["no connection: the cable is out"]
    assert "the cable is out" in desk.told(DRONE)[0]
    air.problem = ""
    air.news.append(desk.report(DRONE, "NorthGate"))
    desk.go(5)
    assert desk.fleet.picture().assets[DRONE].comms != "lost"
    assert desk.told(ON_AIR)[-1] == "connected again"
    desk.fleet.send(command(1, DRONE, "move_to", "EastGate"))
    assert len(air.sent) == 1, "what was not sent before is sent when it is asked for again"


def test_a_link_that_raises_ends_nothing(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    air, ground = desk.links

    def broken(*_: object) -> None:
        raise RuntimeError("a fault of the link's own")

    for member in ("send", "take", "close"):
        monkeypatch.setattr(air, member, broken)
    ground.news.append(desk.report(ROBOT, "EastGate"))
    desk.fleet.send(command(1, DRONE, "hold"))
    desk.go(5)
    assert desk.fleet.picture().assets[ROBOT].available
    assert len([text for text in desk.told(ON_AIR) if "a fault of the link's own" in text]) == 2
    desk.fleet.close()
    assert ground.closed


@pytest.mark.parametrize("held_up_s", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("forged_m", [0.0, 60.0])
def test_a_station_that_was_held_up_takes_a_moving_asset_for_no_forgery(
    desk: Desk, world: World, held_up_s: float, forged_m: float
) -> None:
    air, _ = desk.links
    (x, y), speed_mps = world.frames["Base"].at, world.platforms["uav"].speed_mps

    def fly(steps: int) -> None:
        for _ in range(steps):
            east_m = speed_mps * (desk.time.now() - EPOCH).total_seconds()
            at = (x + east_m, y)
            air.news.append(
                desk.report(DRONE, "Base", position=at, speed_mps=speed_mps, task="moving")
            )
            desk.go()

    fly(10)
    desk.time.steps += round(held_up_s / world.dt_s)  # the drone flies on, the clock stands still
    x += forged_m
    fly(10)
    expected = "suspect" if forged_m else "ok"
    assert desk.fleet.picture().assets[DRONE].integrity == expected


@pytest.mark.parametrize("stall_s", [0.1, 0.3, 0.4, 2.0])
def test_a_station_that_stalls_while_it_takes_reports_in_takes_a_moving_asset_for_no_forgery(
    desk: Desk, world: World, stall_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    air, _ = desk.links
    (x, y), speed_mps = world.frames["Base"].at, world.platforms["uav"].speed_mps
    take, steps = air.take, [0]

    def stalling() -> Sequence[LinkNews]:
        if steps[0] == 20:
            desk.time.steps += round(stall_s / world.dt_s)
        return take()

    monkeypatch.setattr(air, "take", stalling)
    doubts = list[str]()
    for step in range(40):
        steps[0] = step
        if step % 5 == 0:
            east_m = speed_mps * (desk.time.now() - EPOCH).total_seconds()
            at = (x + east_m, y)
            air.news.append(
                desk.report(DRONE, "Base", position=at, speed_mps=speed_mps, task="moving")
            )
        desk.go()
        doubts.append(desk.fleet.picture().assets[DRONE].integrity)
    assert set(doubts) == {"ok"}


def test_an_asset_beside_a_drone_that_reports_no_detections_is_not_unseen(desk: Desk) -> None:
    air, ground = desk.links
    for _ in range(60):
        air.news.append(desk.report(DRONE, "NorthGate"))
        ground.news.append(desk.report(UGV, "NorthGate"))
        desk.go()
    assert desk.fleet.picture().assets[UGV].integrity == "ok"
    for _ in range(60):
        air.news.append(desk.report(DRONE, "NorthGate"))
        air.news.append(SensorReport(DRONE, desk.time.now()))
        ground.news.append(desk.report(UGV, "NorthGate"))
        desk.go()
    assert desk.fleet.picture().assets[UGV].integrity == "suspect"


def test_what_sensors_on_a_link_detect_becomes_a_track(desk: Desk, world: World) -> None:
    air, _ = desk.links
    air.news.append(desk.report(DRONE, "NorthGate"))
    desk.go(5)
    x, y = world.frames["NorthGate"].at
    van = ContactReport("van", "vehicle", (x + 5.0, y + 5.0), sigma_m=0.5)
    for sensor in (DRONE, "Drone_T02"):
        air.news.append(SensorReport(sensor, desk.time.now(), (van,)))
    air.news.append(LinkNotice("warning", DRONE, "the lens is dirty"))
    desk.go(5)
    (track,) = desk.fleet.picture().tracks.values()
    assert track.seen_by == (DRONE,)
    assert desk.told(DRONE) == ["the lens is dirty"]


def test_the_newest_map_of_the_robots_is_the_fleet_s(desk: Desk) -> None:
    assert isinstance(desk.fleet, MapsGround)
    assert desk.fleet.background is None
    older, newer = (Background(origin=(0.0, 0.0), cell_m=1.0, rows=(row,)) for row in "#.")
    desk.links[0].news += [GroundMap(older), GroundMap(newer)]
    desk.go()
    assert desk.fleet.background == newer


def test_an_asset_on_two_links_is_an_error_at_the_start(world: World) -> None:
    links = [ScriptedLink(ON_AIR, {DRONE, UGV}), ScriptedLink(ON_GROUND, {UGV})]
    with pytest.raises(ValueError, match=r"Ugv_T01 is on two links, air:1 and ground:2"):
        LinkedFleet(world, links)
    with pytest.raises(ValueError, match=r"Tank_T01, which is not an asset"):
        LinkedFleet(world, [ScriptedLink(ON_AIR, {"Tank_T01"})])
    with pytest.raises(ValueError, match=r"air:1 is given twice"):
        LinkedFleet(world, [ScriptedLink(ON_AIR, {DRONE}), ScriptedLink(ON_AIR, {UGV})])


def test_only_a_command_that_its_check_admits_goes_to_a_link_once(desk: Desk) -> None:
    air, _ = desk.links
    tokens: list[str | None] = []

    def verify(token: str | None, command: DeviceCommand) -> str:
        tokens.append(token)
        return "" if token is not None else "it has no authorization"

    desk.fleet.use(lambda given: "token" if given.target == "EastGate" else None, verify)
    good, bad = (command(n, DRONE, "move_to", at) for n, at in enumerate(("EastGate", "WestGate")))
    for given in (good, bad, good, bad, command(3, DRONE, "hold")):
        desk.fleet.send(given)
    desk.go()
    assert [c.verb for c in air.sent] == ["move_to", "move_to", "hold"]
    assert {c.target for c in air.sent if c.verb == "move_to"} == {"EastGate"}
    assert desk.replies == [("M1.1", "refused", "it has no authorization")] * 2
    assert tokens == ["token", None], "a token is used once"


@pytest.mark.parametrize("dead", ["before", "after"])
def test_a_stop_is_confirmed_by_the_links_that_work_and_never_by_a_dead_one(
    world: World, dead: str
) -> None:
    team = {DRONE, UGV}
    small = world.model_copy(update={"assets": {name: world.assets[name] for name in sorted(team)}})
    air, ground = ScriptedLink(ON_AIR, {DRONE}), ScriptedLink(ON_GROUND, {UGV})
    desk = Desk(small, air, ground)
    stops = EmergencyStop(desk.fleet, CommandGate(desk.fleet, Journal()))
    doubts: list[dict[str, str]] = []

    def go(steps: int) -> None:
        for _ in range(steps):
            for link in (air, ground):
                if not link.problem:
                    (name,) = link.agents
                    link.news.append(desk.report(name, "NorthGate", task="holding"))
            desk.time.steps += 1
            replies = desk.fleet.step().replies
            events = stops.step((desk.fleet.tick, replies))
            doubts.extend(dict(e.assets) for e in events if isinstance(e, ev.StopUnconfirmed))

    go(5)
    if dead == "before":
        air.problem = "the cable is out"
    stops.hold_all()
    assert [(c.verb, c.agent) for c in ground.sent] == [("hold", UGV)]
    ground.answer("done")
    if dead == "after":
        air.answer("done")
        air.problem = "the cable is out"
    go(40)
    assert stops.waiting
    assert doubts
    assert set(doubts[-1]) == {DRONE}
    assert doubts[-1][DRONE] in ("no answer", "no telemetry since")
    air.problem = ""
    go(40)
    air.answer("done")
    go(20)
    assert doubts[-1] == {}
    assert not stops.waiting
