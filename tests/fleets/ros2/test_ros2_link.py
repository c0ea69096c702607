"""The link commands robots that are rclpy nodes in another process, over DDS on this machine."""

import math
import os
from collections.abc import Iterator
from pathlib import Path
from threading import Event

import pytest

from pa_console.fleets.link import GroundMap
from pa_console.fleets.reports import AssetReport
from pa_console.schema.world import World
from tests.fleets.ros2.counterpart import REMEDY, Listener, Robots, linked, stop

pytest.importorskip("rclpy", reason=REMEDY)
pytest.importorskip("nav2_msgs", reason=REMEDY)
from tests.fleets.ros2.intruder import Intruder

pytestmark = pytest.mark.long
NAMES = ("Ugv_T01", "Ugv_T02", "Robot_T01")
TEXT = "robots:\n" + "".join(f"  {name}: {{}}\n" for name in NAMES)
FAST = {"top_mps": 40.0}
WELL = {
    "mode": "", "top_mps": 4.0, "runs_away": False, "_target": None, "silent": False,
    "serves": True, "lifecycle": 3,
}  # fmt: skip


@pytest.fixture(autouse=True, scope="module")
def on_this_machine() -> Iterator[None]:
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    yield
    del os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"]


@pytest.fixture(scope="module")
def robots() -> Iterator[Robots]:
    robots = Robots({name: (10.0 * place, 0.0) for place, name in enumerate(NAMES)})
    yield robots
    robots.close()


@pytest.fixture
def listener(robots: Robots, world: World, tmp_path: Path) -> Iterator[Listener]:
    """A link to robots that stand well; whatever a test makes of them, they are well afterwards."""
    with linked(robots.domain, world, tmp_path, TEXT) as listener:
        listener.heard(*NAMES)
        yield listener
        robots.change(**dict.fromkeys(NAMES, WELL))
        for name in NAMES:
            listener.send(f"end {name}", name, "hold")
            listener.final(f"end {name}")


def test_an_order_is_carried_out(robots: Robots, listener: Listener) -> None:
    before = len(robots.change()["Ugv_T01"]["goals"])
    listener.send("a", "Ugv_T01", "move_to", "NorthGate")
    listener.moving("Ugv_T01")
    moving = listener.report("Ugv_T01")
    assert moving is not None
    assert (moving.task, moving.command_id) == ("moving", "a")
    assert moving.battery_pct == pytest.approx(80.0)
    robots.change(Ugv_T01=FAST)
    assert listener.final("a").detail == "at NorthGate"
    listener.send("a", "Ugv_T01", "move_to", "NorthGate")  # repeated: only its answer is
    listener.until(lambda: listener.statuses("a").count("done") == 2)
    listener.send("b", "Ugv_T01", "block", "NorthGate")
    assert listener.final("b").status == "done"
    listener.until(lambda: (r := listener.report("Ugv_T01")) and r.task == "blocking")
    listener.send("r", "Ugv_T01", "report")
    assert listener.final("r").status == "done"
    assert len(robots.change()["Ugv_T01"]["goals"]) == before + 2
    assert listener.link.problem == ""
    assert {robot.name for robot in listener.link.discover()} == set(NAMES)


def test_a_hold_is_done_once_the_robot_stands(robots: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T01", "move_to", "WestGate")
    listener.moving("Ugv_T01")
    listener.send("h", "Ugv_T01", "hold")
    listener.final("h")
    assert listener.statuses("h") == ["acknowledged", "done"]
    assert listener.final("a").detail == "stopped by a hold"
    assert robots.change()["Ugv_T01"]["speed"] == 0.0
    listener.until(lambda: (r := listener.report("Ugv_T01")) and r.task == "holding")
    listener.send("h", "Ugv_T01", "hold")  # a hold is carried out whenever it comes
    listener.until(lambda: listener.statuses("h").count("done") == 2)


def test_a_newer_order_takes_the_place_of_the_first(robots: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T02", "move_to", "WestGate")
    listener.moving("Ugv_T02")
    listener.send("b", "Ugv_T02", "move_to", "SouthGate")
    robots.change(Ugv_T02=FAST)
    assert listener.final("b").detail == "at SouthGate"
    assert listener.final("a").detail == "a newer order took its place"


def test_orders_that_wait_when_a_hold_comes_are_not_sent(
    robots: Robots, listener: Listener
) -> None:
    before = len(robots.change()["Ugv_T01"]["went_s"])
    busy = Event()
    listener.link._node.post(busy.wait)  # pyright: ignore[reportPrivateUsage]
    listener.send("a", "Ugv_T01", "move_to", "WestGate")
    listener.send("h", "Ugv_T01", "hold")
    busy.set()
    assert listener.final("h").status == "done"
    assert listener.final("a").detail == "stopped by a hold"
    assert len(robots.change()["Ugv_T01"]["went_s"]) == before


def test_a_robot_that_rejects_a_cancel_has_not_stopped(robots: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T01", "move_to", "EastGate")
    listener.moving("Ugv_T01")
    robots.change(Ugv_T01={"mode": "defiant"})
    listener.send("h", "Ugv_T01", "hold")
    listener.rest()
    assert "done" not in listener.statuses("h")
    robots.change(Ugv_T01={"mode": ""})
    listener.send("h", "Ugv_T01", "hold")
    listener.until(lambda: "done" in listener.statuses("h"))


def test_a_robot_that_drives_on_has_not_stopped(robots: Robots, listener: Listener) -> None:
    listener.send("a", "Ugv_T01", "move_to", "SouthGate")
    listener.moving("Ugv_T01")
    robots.change(Ugv_T01={"runs_away": True})
    listener.send("h", "Ugv_T01", "hold")
    listener.final("a")
    listener.rest()
    assert listener.statuses("h") == ["acknowledged"]
    robots.change(Ugv_T01={"runs_away": False, "_target": None})
    assert listener.final("h").status == "done"


@pytest.mark.parametrize(
    ("mode", "status", "detail"),
    [
        ("reject", "refused", "it rejects the goal"),
        ("abort", "failed", "there is no path to the goal (Nav2 error 208): the corridor is clos"),
        ("lie", "failed", "it reports its arrival at WestGate, but its place is"),
    ],
)
def test_what_a_robot_answers_is_told(
    mode: str, status: str, detail: str, robots: Robots, listener: Listener
) -> None:
    robots.change(Ugv_T02={"mode": mode})
    listener.send(f"{mode}1", "Ugv_T02", "move_to", "WestGate")
    final = listener.final(f"{mode}1")
    assert (final.status, final.detail[: len(detail)]) == (status, detail)


def test_a_robot_that_is_killed_in_motion_is_told_and_has_forgotten_its_goal(
    robots: Robots, world: World, tmp_path: Path
) -> None:
    doomed = Robots({"ugv9": (0.0, 0.0)})
    text = "robots: {Ugv_T01: {namespace: /ugv9}}\n"
    with linked(doomed.domain, world, tmp_path, text) as listener:
        listener.heard("Ugv_T01")
        listener.send("a", "Ugv_T01", "move_to", "WestGate")
        listener.moving("Ugv_T01")
        doomed.kill()
        listener.until(lambda: any("navigate_to_pose is gone" in n for n in listener.notices))
        listener.until(lambda: "is called /ugv9/navigate_to_pose" in listener.link.problem)
        assert listener.statuses("a") == ["acknowledged"]
        listener.send("h", "Ugv_T01", "hold")
        listener.send("b", "Ugv_T01", "move_to", "NorthGate")
        assert listener.final("b").detail == "there is no action server /ugv9/navigate_to_pose"
        again = Robots({"ugv9": (0.0, 0.0)}, doomed.domain)
        assert "was it restarted?" in listener.final("a").detail
        listener.until(lambda: not listener.link.problem)
        listener.send("h", "Ugv_T01", "hold")
        assert listener.final("h").status == "done"
        assert again.change()["ugv9"]["went_s"] == []
        again.close()


def test_a_second_action_server_is_told_and_gets_no_goal(
    robots: Robots, listener: Listener
) -> None:
    other = Robots({"Ugv_T02": (0.0, 0.0)}, robots.domain)
    two = "2 action servers are called /Ugv_T02/navigate_to_pose"
    listener.until(lambda: any(two in notice for notice in listener.notices))
    listener.send("a", "Ugv_T02", "move_to", "NorthGate")
    assert listener.final("a").status == "refused"
    assert listener.final("a").detail.startswith(two)
    listener.send("h", "Ugv_T02", "hold")
    assert listener.final("h").status == "done"
    assert other.change()["Ugv_T02"]["went_s"] == []
    other.close()
    listener.until(lambda: listener.link._node.servers["/Ugv_T02/navigate_to_pose"] == 1)  # pyright: ignore[reportPrivateUsage]
    listener.send("b", "Ugv_T02", "move_to", "NorthGate")
    listener.until(lambda: "acknowledged" in listener.statuses("b"))


def test_two_stations_see_each_other_s_goals(
    robots: Robots, listener: Listener, world: World, tmp_path: Path
) -> None:
    with linked(robots.domain, world, tmp_path, TEXT) as second:
        second.heard(*NAMES)
        listener.send("a", "Ugv_T01", "move_to", "WestGate")
        second.until(lambda: any("not given from here" in notice for notice in second.notices))
        second.until(lambda: (r := second.report("Ugv_T01")) and r.task == "moving")
        second.send("h", "Ugv_T01", "hold")
        assert second.final("h").status == "done"
        assert listener.final("a").detail == "cancelled by another program"


@pytest.mark.parametrize(
    ("lack", "why"),
    [
        (
            {"silent": True},
            "no messages arrive on /Ugv_T02/tf; no messages arrive on /Ugv_T02/odom",
        ),
        ({"serves": False}, "there is no action server /Ugv_T02/navigate_to_pose"),
        ({"lifecycle": 2}, "bt_navigator is inactive"),
    ],
)
def test_a_robot_that_lacks_something_is_not_ready_until_it_is_back(
    lack: dict[str, object], why: str, robots: Robots, listener: Listener
) -> None:
    robots.change(Ugv_T02=lack)
    listener.until(lambda: listener.not_ready("Ugv_T02") == why)
    assert any(why.partition(";")[0] in f.found for f in listener.link.examine(0.0))
    listener.send("a", "Ugv_T02", "move_to", "NorthGate")
    assert listener.final("a").status == "refused"
    assert why in listener.final("a").detail
    robots.change(Ugv_T02=WELL)
    listener.until(lambda: listener.not_ready("Ugv_T02") == "")
    listener.send("b", "Ugv_T02", "move_to", "NorthGate")
    listener.until(lambda: "acknowledged" in listener.statuses("b"))


def test_doctor_s_table_has_all_that_comes_and_nothing_is_wrong(listener: Listener) -> None:
    listener.until(lambda: not any(each.consequence for each in listener.link.examine(0.0)))
    listener.until(lambda: any(each.what == "bt_navigator" for each in listener.link.examine(0.0)))
    findings = listener.link.examine(0.0)
    mine = {each.what: each.found for each in findings if each.agent == "Robot_T01"}
    assert {"ready", "map to base_link"} < mine.keys()
    assert mine["/Robot_T01/navigate_to_pose"] == "1 action server"
    for topic in ("tf", "odom", "battery_state"):
        assert mine[f"/Robot_T01/{topic}"].endswith("a second")
    assert findings[-1].what == "/map"


def test_the_robots_map_comes_to_a_station_that_joins_later(listener: Listener) -> None:
    maps = lambda: [news for news in listener.news if isinstance(news, GroundMap)]  # noqa: E731
    (ground,) = listener.until(maps)
    assert ground.background.rows == (".#", ".?", "#.")
    assert ground.background.origin == pytest.approx((10.0, 0.0))


def test_hostile_messages_move_nothing_and_are_told(robots: Robots, listener: Listener) -> None:
    before = listener.report("Ugv_T01")
    assert before is not None
    count, intruder = len(listener.news), Intruder(robots.domain, "Ugv_T01", seed=0)
    try:
        for number in range(2000):
            intruder.send()
            if number % 20 == 0:
                listener.link.wait(0.01)
                listener.news += listener.link.take()
        listener.rest()
        reports = [each for each in listener.news[count:] if isinstance(each, AssetReport)]
        assert {each.agent for each in reports} == set(NAMES)
        mine = [each for each in reports if each.agent == "Ugv_T01"]
        assert all(math.dist(each.position, before.position) < 0.01 for each in mine)
        notices = "\n".join(listener.notices)
        for topic in ("tf", "odom", "battery_state"):
            assert f"Ugv_T01 a message on /Ugv_T01/{topic} is set aside" in notices
        assert "Error" not in notices, "nothing was raised that nobody expected"
        for name in NAMES:
            listener.send(f"h {name}", name, "hold")
            assert listener.final(f"h {name}").status == "done"
    finally:
        intruder.close()


def test_every_robot_is_stopped_and_nothing_is_sent_after_it(
    robots: Robots, listener: Listener
) -> None:
    for press in (stop(robots, listener, NAMES, number) for number in range(8)):
        assert press.sent_after == 0
