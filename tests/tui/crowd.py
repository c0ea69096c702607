"""Pictures of any size: a ring of gates and as many assets as wanted, some of them in trouble."""

import math

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm
from pa_console.schema.telemetry import CameraReport, Picture
from pa_console.schema.world import AssetKind, AssetSpec, Camera, Frame, Lane, World
from tests.tui import living
from tests.tui.site import WORLD, track

KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")
PREFIX = {"uav": "Drone_T", "ugv": "Ugv_T", "robot": "Robot_T"}
HALF_WIDTH_M, HALF_HEIGHT_M = 300.0, 200.0


def world(assets: int, gates: int) -> World:
    """A site with `gates` on an oval and `assets` posted to them in turn."""
    frames = {"Base": Frame(kind="base", at=(0.0, 0.0))}
    lanes: dict[str, Lane] = {}
    cameras: dict[str, Camera] = {}
    for number in range(gates):
        angle = 2 * math.pi * number / gates
        across, up = HALF_WIDTH_M * math.cos(angle), HALF_HEIGHT_M * math.sin(angle)
        name = f"Gate{number + 1:02}"
        frames[name] = Frame(kind="gate", at=(across, up))
        lanes[f"Lane{number + 1:02}"] = Lane(
            gate=name, points=((across * 1.3, up * 1.3), (across * 1.05, up * 1.05))
        )
        cameras[f"Camera{number + 1:02}"] = Camera(
            gate=name, at=(across * 1.03, up * 1.03), heading_deg=0.0, sensor_range_m=60.0
        )
    names = [name for name in frames if name != "Base"]
    team: dict[str, AssetSpec] = {}
    for number in range(assets):
        kind = KINDS[number % 3]
        post = names[number % gates] if number < 3 * gates or number % 4 else "Base"
        team[f"{PREFIX[kind]}{number + 1:04}"] = AssetSpec(kind=kind, post=post)
    edge = ((-320.0, -220.0), (320.0, -220.0), (320.0, 220.0), (-320.0, 220.0))
    changed = {"frames": frames, "lanes": lanes, "cameras": cameras, "assets": team,
               "perimeter": edge, "walls": (), "zones": {}}  # fmt: skip
    return WORLD.model_copy(update=changed)


def crowd(site: World, time_s: float = 300.0) -> Picture:
    """Every asset near its post: each 50th failed, each 33rd silent, each 20th stale."""
    assets: dict[str, dict[str, object]] = {}
    for number, (name, spec) in enumerate(site.assets.items(), start=1):
        x, y = site.frames[spec.post].at
        spread = 4.0 + (number * 7 % 23)
        place = (x * 0.97 + spread * math.cos(number), y * 0.97 + spread * math.sin(number))
        failed, silent, stale = number % 50 == 0, number % 33 == 0, number % 20 == 0
        assets[name] = {
            "id": name, "kind": spec.kind, "at": spec.post, "post": spec.post,
            "position": place, "heading_deg": float(number * 45 % 360), "speed_mps": 0.0,
            "status": "failed" if failed else "ok", "task": "none" if failed else "observing",
            "battery_pct": 80.0, "low_battery": False, "comms": "lost" if silent else "ok",
            "available": not (failed or silent or stale), "stale": silent or stale,
            "stamp_s": time_s - (12.0 if silent else 5.0 if stale else 0.3),
        }  # fmt: skip
    covers = {name: {"covered": name != "Gate07"} for name in site.gates}
    cameras = {
        name: CameraReport(gate=camera.gate, works=name != "Camera05", stamp_s=time_s - 0.2)
        for name, camera in site.cameras.items()
    }
    given = track("Track_01", "Gate03", position=(330.0, 110.0), distance_m=52.0)
    return Picture.model_validate(
        {"tick": round(time_s * 10), "time_s": time_s, "assets": assets, "gates": covers,
         "tracks": {given.id: given}, "cameras": cameras}
    )  # fmt: skip


def opening(site: World) -> list[ev.EventPayload]:
    """The session of a large site, with one alarm."""
    alarm = Alarm(
        id="coverage_lost:Gate07", kind="coverage_lost", priority="high", subject="Gate07",
        gate="Gate07", text="nobody covers Gate07", raised_s=290.0,
    )  # fmt: skip
    return [
        living.STARTED,
        ev.WorkerChanged(state="ready", detail="scripted"),
        ev.TelemetryReceived(picture=crowd(site)),
        ev.AlarmRaised(alarm=alarm),
    ]
