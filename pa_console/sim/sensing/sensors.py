"""Detections, which depend on range, view, line of sight, weather, chance and noise (CAP-03)."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Intent, Weather
from pa_console.schema.world import Sensing
from pa_console.sim.scene import Scene
from pa_console.sim.sensing_state import ContactFinding, ContactState, Detection, Phantom
from pa_console.sim.worlds.terrain import Terrain

CLOSE_STANDOFFS = 2.5
"""The distance, in standoffs, within which a sensor recognizes intent and passengers."""
WATCH_S = 10.0
"""Seconds for which a sensor must watch a contact at close range to form an opinion."""
REPORTING_S = 5.0
"""Seconds for which a robot keeps its proximity sensors on a contact after identifying it."""
AT_FULL_RANGE = 0.5
"""The share of the detection probability that remains at the end of the range."""
WEATHER: dict[Weather, tuple[float, float]] = {
    "clear": (1.0, 1.0),
    "rain": (0.8, 0.85),
    "fog": (0.5, 0.7),
}
"""The shares of a sensor's range and of its detection probability that remain in each weather."""
_PHANTOM_STANDOFFS = 4.0
_PHANTOM_MPS = 2.0
_BOX_MARGIN_M = 0.001

Floats = npt.NDArray[np.float64]
Found = dict[str, tuple[Detection, ...]]


@dataclass(frozen=True, slots=True)
class _Hit:
    """The detection of a contact by a sensor, `gap_m` metres away."""

    sensor: str
    spec: Sensing
    contact: ContactState
    gap_m: float


@dataclass(slots=True)
class _Eyes:
    """The working sensors: names, specs, and `rows` (n, 5) of x, y, range, heading, half view."""

    names: list[str]
    specs: list[Sensing]
    near_gate: list[str | None]
    walled: list[bool]
    rows: Floats


def scan(terrain: Terrain, scene: Scene) -> Found:
    """Return the present detections of every working sensor that detects anything.

    A ground asset that identifies or warns detects the contacts at its gate with certainty,
    regardless of walls and weather; it keeps detecting a contact for a while after identifying it.
    Its findings are repeated in each of its reports, so that a lost report does no harm.
    """
    state = scene.sensing
    if not (state.contacts or state.phantoms):
        return {}
    state.phantoms = tuple(p for p in state.phantoms if scene.tick < p.until_tick)
    by_sensor: dict[str, list[Detection]] = {}
    reported: set[tuple[str, str]] = set()
    if state.contacts:
        for hit in _hits(terrain, scene):
            reported.add((hit.sensor, hit.contact.id))
            by_sensor.setdefault(hit.sensor, []).append(_detection(terrain, scene, hit))
    for sensor, contact_id in state.findings:
        asset = scene.assets[sensor]
        if (sensor, contact_id) not in reported and not asset.down:
            contact = state.contacts[contact_id]
            by_sensor.setdefault(sensor, []).append(_recalled(terrain, scene, sensor, contact))
    for phantom in state.phantoms:
        seen = _imagined(terrain, scene, phantom)
        if seen is not None:
            by_sensor.setdefault(phantom.sensor, []).append(seen)
    return {sensor: tuple(detections) for sensor, detections in by_sensor.items()}


def _hits(terrain: Terrain, scene: Scene) -> list[_Hit]:
    """Return every detection of this scan, in the order of sensors and contacts."""
    contacts = list(scene.contacts.values())
    targets = np.array([contact.position for contact in contacts])
    range_part, chance_part = WEATHER[scene.sensing.weather]
    eyes = _eyes(terrain, scene, targets, range_part)
    if not eyes.names:
        return []
    dx = targets[None, :, 0] - eyes.rows[:, None, 0]
    dy = targets[None, :, 1] - eyes.rows[:, None, 1]
    reached = np.nonzero(dx * dx + dy * dy <= eyes.rows[:, None, 2] ** 2)
    rows = eyes.rows[reached[0]]
    bearing = np.arctan2(dy[reached], dx[reached])
    off = np.abs((bearing - rows[:, 3] + np.pi) % (2 * np.pi) - np.pi)
    viewed = (off <= rows[:, 4] + 1e-9).tolist()
    gaps = np.hypot(dx[reached], dy[reached]).tolist()
    pairs = list(zip(reached[0].tolist(), reached[1].tolist(), strict=True))
    close_by = [eyes.near_gate[s] == contacts[c].gate for s, c in pairs]
    needs = [index for index, (s, _) in enumerate(pairs) if eyes.walled[s] and not close_by[index]]
    clear = np.ones(len(pairs), dtype=np.bool_)
    clear[needs] = terrain.in_sight(rows[needs, :2], targets[reached[1][needs]])
    hits: list[_Hit] = []
    for index, (s, c) in enumerate(pairs):
        if not (close_by[index] or (viewed[index] and clear[index])):
            continue
        spec, reach = eyes.specs[s], float(eyes.rows[s, 2])
        chance = detection_chance(spec, gaps[index], reach) * chance_part
        if scene.ideal or close_by[index] or scene.rng.random() < chance:
            hits.append(_Hit(eyes.names[s], spec, contacts[c], gaps[index]))
    return hits


def detection_chance(spec: Sensing, gap_m: float, reach_m: float) -> float:
    """Return the chance of a detection; the loss grows with the fourth power of the distance."""
    return spec.detection_probability * (1.0 - (1.0 - AT_FULL_RANGE) * (gap_m / reach_m) ** 4)


def _eyes(terrain: Terrain, scene: Scene, targets: Floats, range_part: float) -> _Eyes:
    """Collect the working sensors, cameras first; assets that identify or warn have full range.

    Assets too far from the bounding box of `targets` (n, 2) to detect any of them are left out.
    """
    (left, low), (right, high) = targets.min(axis=0).tolist(), targets.max(axis=0).tolist()
    world, broken = terrain.world, scene.sensing.broken
    eyes = _Eyes([], [], [], [], np.zeros((0, 5)))
    rows: list[tuple[float, float, float, float, float]] = []
    for name, camera in world.cameras.items():
        if name not in broken:
            eyes.names.append(name)
            eyes.specs.append(camera)
            eyes.near_gate.append(None)
            eyes.walled.append(True)
            half = math.radians(camera.field_of_view_deg / 2)
            reach = camera.sensor_range_m * range_part
            rows.append((*camera.at, reach, math.radians(camera.heading_deg), half))
    kinds = {
        kind: (spec, spec.sensor_range_m, math.radians(spec.field_of_view_deg / 2), kind != "uav")
        for kind, spec in world.platforms.items()
    }
    far = max(spec.sensor_range_m for spec in world.platforms.values()) + _BOX_MARGIN_M
    left, right, low, high = left - far, right + far, low - far, high + far
    for asset in scene.assets.values():
        x, y = asset.x, asset.y
        if not (left <= x <= right and low <= y <= high) or asset.down or asset.id in broken:
            continue
        spec, reach, half, walled = kinds[asset.kind]
        near = asset.post if asset.task in ("identifying", "warning") else None
        eyes.names.append(asset.id)
        eyes.specs.append(spec)
        eyes.near_gate.append(near)
        eyes.walled.append(walled)
        rows.append((x, y, reach if near else reach * range_part, asset.heading, half))
    eyes.rows = np.array(rows).reshape(-1, 5)
    return eyes


def _detection(terrain: Terrain, scene: Scene, hit: _Hit) -> Detection:
    """Measure a contact, form the sensor's opinion of it, and count the time of watching."""
    state, world, contact = scene.sensing, terrain.world, hit.contact
    key = (hit.sensor, contact.id)
    finding = state.findings.get(key, ContactFinding())
    opinion: Intent = finding.opinion
    close = hit.gap_m <= CLOSE_STANDOFFS * world.standoff_m
    if close:
        state.watched[key] = state.watched.get(key, 0) + 1
        if state.watched[key] * world.telemetry_period_s >= WATCH_S:
            opinion = contact.intent
    sigma = 0.0 if scene.ideal else hit.spec.position_noise_m
    return Detection(
        contact=contact.id,
        kind=contact.kind,
        position=_measured(terrain, scene, hit.sensor, contact.position, sigma),
        sigma_m=sigma,
        identity=finding.identity,
        opinion=opinion,
        noncombatants=close and contact.noncombatants,
        emergency=close and contact.emergency,
        warned_tick=finding.warned_tick,
    )


def _recalled(terrain: Terrain, scene: Scene, sensor: str, contact: ContactState) -> Detection:
    """Repeat a robot's findings about a contact that it does not detect now.

    The position is included if the robot has just identified the contact and is at its gate.
    """
    finding = scene.sensing.findings[sensor, contact.id]
    spec = terrain.world.platforms[scene.assets[sensor].kind]
    sigma = 0.0 if scene.ideal else spec.position_noise_m
    has_it = _still_has(terrain, scene, sensor, contact, finding)
    at = _measured(terrain, scene, sensor, contact.position, sigma) if has_it else None
    return Detection(
        contact=contact.id,
        kind=contact.kind,
        position=at,
        sigma_m=0.0 if at is None else sigma,
        identity=finding.identity,
        opinion=finding.opinion,
        warned_tick=finding.warned_tick,
    )


def _still_has(
    terrain: Terrain, scene: Scene, sensor: str, contact: ContactState, finding: ContactFinding
) -> bool:
    """Return whether a robot that identified the contact still has it in its proximity sensors."""
    asset, world = scene.assets[sensor], terrain.world
    if finding.identified_tick is None or sensor in scene.sensing.broken:
        return False
    since_s = (scene.tick - finding.identified_tick) * world.dt_s
    gap_m = math.dist(asset.position, contact.position)
    near = asset.post == contact.gate and gap_m <= world.platforms[asset.kind].sensor_range_m
    return near and since_s <= REPORTING_S


def _measured(terrain: Terrain, scene: Scene, sensor: str, point: Point, sigma_m: float) -> Point:
    """Return `point` as measured with a normal error of `sigma_m` on each axis.

    An asset measures from its estimated position, so its own drift is added.
    """
    asset = scene.assets.get(sensor)
    if asset is not None and asset.drift is not None:
        point = asset.drift.applied(point, scene.tick, terrain.world.dt_s)
    if sigma_m == 0.0:
        return point
    return (point[0] + scene.rng.gauss(0.0, sigma_m), point[1] + scene.rng.gauss(0.0, sigma_m))


def _imagined(terrain: Terrain, scene: Scene, phantom: Phantom) -> Detection | None:
    """Return the detection of a phantom, which creeps along its lane; None if it is missed."""
    world, state = terrain.world, scene.sensing
    camera, asset = world.cameras.get(phantom.sensor), scene.assets.get(phantom.sensor)
    spec = camera or (world.platforms[asset.kind] if asset else None)
    if spec is None or phantom.sensor in state.broken or (asset is not None and asset.down):
        return None
    if scene.rng.random() >= spec.detection_probability:
        return None
    line = terrain.lanes[phantom.lane]
    start = line.first_within(_PHANTOM_STANDOFFS * world.standoff_m)
    crept = (scene.tick - phantom.from_tick) * world.dt_s * _PHANTOM_MPS
    point, _ = line.locate(min(line.waiting_m, start + crept))
    sigma = spec.position_noise_m
    at = _measured(terrain, scene, phantom.sensor, point, sigma)
    return Detection(contact=phantom.id, kind="vehicle", position=at, sigma_m=sigma)
