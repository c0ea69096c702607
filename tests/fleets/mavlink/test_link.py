"""Drones of another library, in another process: flown, stopped, refused, and lost."""

import random
import socket
from pathlib import Path

import pytest

from pa_console.fleets import threaded_link
from pa_console.fleets.mavlink.link import open_link
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from tests.fleets.mavlink.drones import ARDUPILOT, flown, free_port, on_the_earth, vehicles_file

ONE, TWO = "Drone_T01", "Drone_T02"


def test_a_px4_and_an_ardupilot_fly_hold_observe_and_come_home(
    world: World, tmp_path: Path
) -> None:
    names = (ONE, TWO)
    with flown(world, tmp_path, names, "--rate", "4", flies=False, autopilots=(12, ARDUPILOT)) as (
        driven,
        drones,
    ):
        driven.until(lambda: driven.fenced(2))
        assert not any(each["armed"] for each in drones.say().values()), "not armed at connect"
        driven.send("a1", ONE, "move_to", "EastGate")
        driven.send("b1", TWO, "observe", "SouthGate")
        assert driven.end("a1").status == "done"
        assert driven.end("b1").status == "done"
        assert driven.reports[TWO].task == "observing"
        assert drones.say()[TWO]["region"] is not None
        driven.send("a2", ONE, "move_to", "WestGate")
        driven.until(lambda: driven.reports[ONE].speed_mps > 1.0)
        driven.send("a3", ONE, "hold")
        assert driven.end("a3").status == "done"
        assert driven.end("a2").status == "failed"
        assert driven.reports[ONE].speed_mps == 0.0
        driven.send("a4", ONE, "return_to_base")
        driven.send("b4", TWO, "return_to_base")
        assert driven.end("a4").detail == driven.end("b4").detail == "at Base"
        said = drones.say()
        assert not any(each["armed"] for each in said.values())
        for each in said.values():
            moved = {c: n for c, n in each["carried_out"].items() if c.startswith("192")}
            assert set(moved.values()) <= {1}, "no move was carried out twice"


def test_what_a_drone_refuses_or_does_not_do_is_said_in_its_own_words(
    world: World, tmp_path: Path
) -> None:
    with flown(world, tmp_path, (ONE, TWO)) as (driven, drones):
        driven.until(lambda: driven.fenced(2))
        drones.tell(ONE, mode="denying")
        drones.tell(TWO, mode="failing")
        driven.send("a1", ONE, "move_to", "SouthGate")
        driven.send("b1", TWO, "move_to", "EastGate")
        assert driven.end("a1").detail == (
            "reposition denied: Arming denied: compass not calibrated"
        )
        assert driven.end("b1").detail == "reposition failed: Motor 3 reports a fault"
        drones.tell(ONE, mode="obedient", flight_mode="POSCTL")
        driven.until(lambda: driven.reports[ONE].manual)
        driven.send("a2", ONE, "move_to", "NorthGate")
        assert "a pilot flies it (POSCTL)" in driven.end("a2").detail


def test_a_corner_of_the_fence_that_somebody_moves_is_named(world: World, tmp_path: Path) -> None:
    with flown(world, tmp_path, (ONE,), more="fence_check_s: 1.0") as (driven, drones):
        driven.until(lambda: driven.fenced(1))
        drones.tell(ONE, corner=[2, 500])
        driven.until(lambda: driven.told("corner 3 of the perimeter"))
        driven.send("a1", ONE, "move_to", "NorthGate")
        assert "corner 3 of the perimeter is at" in driven.end("a1").detail
        assert "192" not in str(drones.say()[ONE]["carried_out"])


def test_one_that_would_not_act_on_its_fence_is_refused(world: World, tmp_path: Path) -> None:
    with flown(world, tmp_path, (ONE,), more="fence_check_s: 1.0") as (driven, drones):
        drones.tell(ONE, fence_action=0)
        driven.until(lambda: driven.told("GF_ACTION is 0") and ONE in driven.reports)
        driven.send("a1", ONE, "move_to", "NorthGate")
        assert "set it to 2 (hold)" in driven.end("a1").detail


def test_a_drone_that_asks_is_armed_for_an_order_only(world: World, tmp_path: Path) -> None:
    with flown(world, tmp_path, (ONE,), flies=False) as (driven, drones):
        driven.until(lambda: driven.fenced(1))
        drones.tell(ONE, authorize=245)
        driven.until(lambda: driven.told("asked to be armed without an order"))
        driven.until(lambda: any(line.startswith("ack 3001") for line in drones.say()[ONE]["log"]))
        assert "ack 3001 0" not in drones.say()[ONE]["log"]
        drones.tell(ONE, mode="slow", slow_s=600.0)
        driven.send("a1", ONE, "move_to", "NorthGate")
        driven.until(lambda: "command 400" in drones.say()[ONE]["log"])
        drones.tell(ONE, authorize=245)
        driven.until(lambda: "ack 3001 0" in drones.say()[ONE]["log"])


def test_a_link_without_drones_has_a_problem_and_a_way_back(world: World, tmp_path: Path) -> None:
    with flown(world, tmp_path, (ONE,)) as (driven, drones):
        driven.until(lambda: driven.fenced(1))
        assert driven.link.problem == ""
        drones.tell(ONE, down=True)
        driven.until(lambda: driven.told("is no longer heard"))
        assert "no drone is heard" in driven.link.problem
        driven.send("h1", ONE, "hold")
        driven.take()
        assert driven.last("h1") is None or driven.last("h1").status != "done"  # type: ignore[union-attr]
        drones.tell(ONE, down=False)
        driven.until(lambda: driven.told("is heard again"))
        assert driven.link.problem == ""


def test_nobody_there_is_an_error_with_the_remedy(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threaded_link, "PATIENCE_S", 0.1)
    there, port = on_the_earth(world), free_port()
    file = vehicles_file(tmp_path, there, (ONE,))
    with pytest.raises(ValueError, match=r"no drone is heard .* expected system id 1"):
        open_link(f"udpin://127.0.0.1:{port}#{file}", there, Settings())


def test_hostile_messages_raise_nothing_and_move_nothing(
    world: World, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with flown(world, tmp_path, (ONE,)) as (driven, drones):
        driven.until(lambda: driven.fenced(1) and ONE in driven.reports)
        before = driven.reports[ONE].position
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for message in hostile(2000, seed=3):
                sender.sendto(message, ("127.0.0.1", drones.port))
        driven.send("a1", ONE, "report")
        assert driven.end("a1").status == "done"
        sent = driven.reports[ONE].sent
        driven.until(lambda: driven.reports[ONE].sent > sent)
        assert driven.reports[ONE].position == pytest.approx(before, abs=0.1)
    out, err = capfd.readouterr()
    assert out == err == "", "nothing is printed on the console's screen"


def hostile(count: int, seed: int) -> list[bytes]:
    """Return datagrams: noise, cut and changed frames, strangers, impossible values."""
    mavlink = pytest.importorskip("pymavlink.dialects.v20.common")
    draw = random.Random(seed)
    made: list[bytes] = []
    while len(made) < count:
        system = draw.choice((1, 1, 7, 99, 250, 255))
        mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=draw.choice((1, 1, 2, 190)))
        number = draw.randint(-(2**31), 2**31 - 1)
        short = draw.randint(-(2**15), 2**15 - 1)
        text = bytes(draw.randrange(256) for _ in range(50))
        message = draw.choice(
            (
                mav.heartbeat_encode(2, draw.choice((3, 8, 12)), 1, 0, draw.randrange(9)),
                mav.global_position_int_encode(0, 91 * 10**7, number, number, number, 0, 0, 0, 0),
                mav.global_position_int_encode(0, 0, 0, number, number, short, 0, 0, 65535),
                mav.statustext_encode(draw.randrange(256), text),
                mav.command_ack_encode(draw.choice((192, 400, 176)), draw.randrange(256)),
                mav.home_position_encode(number, number, 0, 0, 0, 0, [0, 0, 0, 0], 0, 0, 0),
                mav.mission_count_encode(255, 190, draw.randrange(65536), draw.randrange(256)),
                mav.param_value_encode(b"GF_ACTION", float("nan"), 6, 1, 0),
                mav.sys_status_encode(0, 0, 0, 0, 0, 0, draw.randint(-128, 127), 0, 0, 0, 0, 0, 0),
            )
        )
        frame = bytearray(message.pack(mav))
        match draw.randrange(4):
            case 0:
                frame = bytearray(draw.randrange(256) for _ in range(draw.randrange(1, 280)))
            case 1:
                frame = frame[: draw.randrange(1, len(frame))]
            case 2:
                frame[draw.randrange(len(frame))] ^= 1 << draw.randrange(8)
            case _:
                pass
        made.append(bytes(frame))
    return made
