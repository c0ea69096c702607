"""The link commands robots with Nav2 in another process, in both layouts, and reports on them."""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
import zenoh

from pa_console.fleets.reports import AssetReport
from pa_console.schema.world import AssetSpec, World
from tests.fleets.ros2 import wire
from tests.fleets.ros2.counterpart import Cable, Listener, Robots, linked
from tests.fleets.ros2.wire import Header, Pose, Quaternion, Time, Vector3

NAMES = ("Ugv_T01", "Ugv_T02", "Robot_T01")
TEXT = "robots:\n" + "".join(f"  {name}: {{}}\n" for name in NAMES)
FAST = {"top_mps": 40.0}


@pytest.fixture(scope="module")
def bridged() -> Iterator[Robots]:
    robots = Robots({name: (10.0 * place, 0.0) for place, name in enumerate(NAMES)})
    yield robots
    robots.close()


@pytest.fixture
def listener(bridged: Robots, world: World, tmp_path: Path) -> Iterator[Listener]:
    """A link to robots that stand well; whatever a test makes of them, they are well afterwards."""
    with linked(bridged.port, world, tmp_path, TEXT) as listener:
        listener.heard(*NAMES)
        yield listener
    well = {"mode": "", "top_mps": 4.0, "runs_away": False, "goal": None, "charge": 0.8, "level": 0}
    bridged.change(**dict.fromkeys(NAMES, well))


@pytest.mark.parametrize(("layout", "release"), [("bridge", "humble"), ("rmw", "kilted")])
def test_an_order_is_carried_out_in_both_layouts(
    layout: str, release: str, world: World, tmp_path: Path
) -> None:
    robots = Robots({"ugv1": (0.0, 0.0)}, "--layout", layout, "--release", release)
    try:
        text = "robots: {Ugv_T01: {namespace: ugv1}}\n"
        with linked(robots.port, world, tmp_path, text) as listener:
            assert listener.link.name == f"ros2:tcp/127.0.0.1:{robots.port} ({layout})"
            assert listener.link.agents == {"Ugv_T01"}
            listener.heard("Ugv_T01")
            listener.send("a", "Ugv_T01", "move_to", "NorthGate")
            listener.until(lambda: (r := listener.report("Ugv_T01")) and r.speed_mps > 0.0)
            moving = listener.report("Ugv_T01")
            assert moving is not None
            assert (moving.task, moving.command_id) == ("moving", "a")
            assert moving.heading_deg == pytest.approx(90.0)
            robots.change(ugv1=FAST)
            assert listener.final("a").detail == "at NorthGate"
            listener.send("b", "Ugv_T01", "block", "NorthGate")
            assert listener.final("b").status == "done"
            listener.until(
                lambda: (
                    (r := listener.report("Ugv_T01")) and (r.task, r.speed_mps) == ("blocking", 0)
                )
            )
            robots.change(ugv1={"mode": "abort"})
            listener.send("c", "Ugv_T01", "return_to_base")
            reason = {"humble": "it gave up and gives no reason"}.get(release, "corridor is closed")
            assert reason in listener.final("c").detail
            found = listener.link.discover()
            assert [robot.name for robot in found] == ["Ugv_T01"]
        assert len(robots.change()["ugv1"]["executed"]) == 3
    finally:
        robots.close()


def test_a_hold_is_done_once_the_robot_stands(bridged: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T01", "move_to", "WestGate")
    listener.until(lambda: (r := listener.report("Ugv_T01")) and r.speed_mps > 0.0)
    listener.send("h", "Ugv_T01", "hold")
    listener.final("h")
    assert listener.statuses("h") == ["acknowledged", "done"]
    assert listener.final("a").detail == "stopped by a hold"
    assert bridged.change()["Ugv_T01"]["speed"] == 0.0
    listener.until(lambda: (r := listener.report("Ugv_T01")) and r.task == "holding")
    listener.send("h", "Ugv_T01", "hold")  # a hold is carried out whenever it comes
    listener.until(lambda: listener.statuses("h").count("done") == 2)


def test_a_robot_that_rejects_a_cancel_has_not_stopped(bridged: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T01", "move_to", "EastGate")
    listener.until(lambda: "acknowledged" in listener.statuses("a"))
    bridged.change(Ugv_T01={"mode": "defiant"})
    listener.send("h", "Ugv_T01", "hold")
    assert listener.final("h").status == "refused"
    bridged.change(Ugv_T01={"mode": ""})
    listener.send("h", "Ugv_T01", "hold")
    listener.until(lambda: "done" in listener.statuses("h"))


def test_a_robot_that_drives_on_has_not_stopped(bridged: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T01", "move_to", "SouthGate")
    listener.until(lambda: (r := listener.report("Ugv_T01")) and r.speed_mps > 0.0)
    bridged.change(Ugv_T01={"runs_away": True})
    listener.send("h", "Ugv_T01", "hold")
    listener.final("a")
    count = len(listener.news)
    listener.until(lambda: len(listener.news) > count + 6)
    assert listener.statuses("h") == ["acknowledged"]
    bridged.change(Ugv_T01={"runs_away": False, "goal": None})
    assert listener.final("h").status == "done"


@pytest.mark.parametrize(
    ("mode", "status", "detail"),
    [
        ("reject", "refused", "it rejects the goal"),
        ("abort", "failed", "there is no path to the goal (Nav2 error 208)"),
        ("lie", "failed", "it says that it is at WestGate, but reports itself"),
    ],
)
def test_what_a_robot_answers_is_told(
    mode: str, status: str, detail: str, bridged: Robots, listener: Listener
) -> None:
    bridged.change(Ugv_T02={"mode": mode})
    listener.send(f"{mode}1", "Ugv_T02", "move_to", "WestGate")
    final = listener.final(f"{mode}1")
    assert (final.status, final.detail[: len(detail)]) == (status, detail)


def test_a_robot_that_answers_nothing_has_acknowledged_nothing(
    bridged: Robots, listener: Listener
) -> None:
    bridged.change(Robot_T01={"mode": "silent"})
    before = len(bridged.change()["Robot_T01"]["executed"])
    listener.send("s", "Robot_T01", "move_to", "WestGate")
    listener.send("h", "Robot_T01", "hold")
    count = len(listener.news)
    listener.until(lambda: len(listener.news) > count + 6)
    assert listener.statuses("s") == listener.statuses("h") == []
    assert len(bridged.change()["Robot_T01"]["executed"]) == before


def test_reports_and_their_faults_are_told(bridged: Robots, listener: Listener) -> None:
    bridged.change(Ugv_T02={"charge": 0.1, "level": 2})
    report = listener.until(
        lambda: r if (r := listener.report("Ugv_T02")) and r.status == "failed" else None
    )
    assert report.battery_pct == pytest.approx(10.0)
    assert report.task == "none"
    assert "Ugv_T02 reports its condition as failed: a motor is hot" in listener.notices
    listener.send("r", "Ugv_T02", "report")
    assert listener.final("r").status == "done"


def hostile(port: int) -> zenoh.Session:
    """Another client of the same router, which anybody on the network can be."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def test_what_cannot_be_read_is_told_and_changes_nothing(
    bridged: Robots, listener: Listener
) -> None:
    other = hostile(bridged.port)
    try:
        far = Pose(Vector3(1e9, 0.0, 0.0), Quaternion())
        ahead = Header(Time(2_000_000_000, 0), "odom")
        moved = wire.Transform(Vector3(5.0, 5.0, 0.0), Quaternion())
        for payload in (b"", b"\0\1\0\0\xff\xff\xff\xff"):
            for topic in ("tf", "odom", "battery_state", "navigate_to_pose/_action/status"):
                other.put(f"Ugv_T01/{topic}", payload)
        covariance = wire.PoseWithCovariance(far)
        twist = wire.TwistWithCovariance(wire.Twist(Vector3(), Vector3()))
        other.put("Ugv_T01/odom", wire.Odometry(ahead, "x", covariance, twist).serialize())
        jump = wire.TFMessage([wire.TransformStamped(ahead, "base_footprint", moved)])
        other.put("Ugv_T01/tf", jump.serialize())
        listener.until(
            lambda: all(
                any(f"message on {kind} is set aside" in notice for notice in listener.notices)
                for kind in ("tf", "odom", "battery", "status")
            )
        )
        count = len(listener.news)
        listener.until(lambda: len(listener.news) > count + 6)
        report = listener.report("Ugv_T01")
        assert report is not None
        assert report.position != (5.0, 5.0)
    finally:
        other.close()


def test_a_flood_is_told_and_others_are_heard(bridged: Robots, listener: Listener) -> None:
    other = hostile(bridged.port)
    try:
        publisher = other.declare_publisher("Ugv_T01/odom")

        def told() -> bool:
            for _ in range(500):
                publisher.put(b"noise")
            return "Ugv_T01 sends so much on odom that some of it goes unread" in listener.notices

        listener.until(told)
        count = len(listener.news)
        listener.until(lambda: len(listener.news) > count + 6)
        assert listener.report("Ugv_T02") is not None
        listener.send("f", "Ugv_T02", "hold")
        assert listener.final("f").status == "done"
    finally:
        other.close()


def test_a_cut_cable_is_a_problem_and_nothing_waits_to_be_sent(
    bridged: Robots, world: World, tmp_path: Path
) -> None:
    cable = Cable(bridged.port)
    try:
        with linked(cable.port, world, tmp_path, TEXT) as listener:
            listener.heard(*NAMES)
            assert listener.link.problem == ""
            listener.send("x", "Ugv_T01", "move_to", "WestGate")
            listener.until(lambda: "acknowledged" in listener.statuses("x"))
            cable.cut()
            listener.until(lambda: listener.link.problem)
            before = len(bridged.change()["Ugv_T02"]["executed"])
            listener.send("y", "Ugv_T02", "move_to", "WestGate")
            cable.mend()
            listener.until(lambda: not listener.link.problem)
            bridged.change(Ugv_T01=FAST)
            assert listener.final("x").status == "done"
            assert listener.statuses("y") == []
            state = bridged.change()
            assert len(state["Ugv_T02"]["executed"]) == before
            assert not any(robot["crashed"] for robot in state.values())
    finally:
        cable.close()


def test_no_hold_of_a_burst_gets_lost(world: World, tmp_path: Path) -> None:
    names = [f"Ugv_C{number:02}" for number in range(24)]
    spec = AssetSpec(kind="ugv", post="Checkpoint")
    large = world.model_copy(update={"assets": dict.fromkeys(names, spec)})
    robots = Robots(dict.fromkeys(names, (0.0, 0.0)), "--rate-hz", "4")
    text = "robots:\n" + "".join(f"  {name}: {{}}\n" for name in names)
    try:
        with linked(robots.port, large, tmp_path, text) as listener:
            listener.heard(*names)
            for name in names:
                listener.send(name, name, "move_to", "WestGate")
            listener.until(lambda: all(listener.statuses(name) for name in names))
            for name in names:
                listener.send(f"h-{name}", name, "hold")
            for name in names:
                assert listener.final(f"h-{name}").status == "done"
            assert not any(robot["speed"] for robot in robots.change().values())
    finally:
        robots.close()


def test_reports_that_came_while_nobody_looked_are_taken_in_one_by_one(
    bridged: Robots, listener: Listener
) -> None:
    """Else a robot that stood before and stands after would seem to creep while it stands."""
    before = listener.report("Robot_T01")
    assert before is not None
    count = len(listener.news)
    listener.send("q", "Robot_T01", "move_to", "WestGate")
    while math.dist(bridged.change()["Robot_T01"]["at"], before.position) < 6.0:
        pass
    bridged.change(Robot_T01={"goal": None})  # it says that it is there, and stands
    listener.final("q")
    reports = [r for r in listener.news[count:] if isinstance(r, AssetReport)]
    way = [before, *(r for r in reports if r.agent == "Robot_T01")]
    assert any(report.speed_mps > 0.0 for report in way)
    for last, report in pairwise(way):
        assert math.dist(last.position, report.position) < 4.0
        assert report.speed_mps > 0.0 or last.speed_mps > 0.0 or report.position == last.position
