"""The physical link of each asset: what works, what it loses, how long a message takes (CAP-05)."""

import math

from pa_console.schema.incident import JamArea, SetRadio
from pa_console.schema.telemetry import CommsStatus
from pa_console.schema.world import World
from pa_console.sim.state.link_state import Jam, RadioState
from pa_console.sim.state.scene import AssetState, Scene

DEGRADED = RadioState(latency_s=0.3, jitter_s=0.9, loss=0.3)
"""The values of `comms: degraded`; `lost` is an outage, `ok` the link as the world has it."""


def works(scene: Scene, asset: AssetState) -> bool:
    """Return whether anything passes between the station and `asset` now: no outage, no jam."""
    return asset.radio.up and not (scene.link.jams and _jammed(scene, asset))


def quality(world: World, scene: Scene, asset: AssetState) -> CommsStatus:
    """Return how the link of `asset` truly is."""
    if not works(scene, asset):
        return "lost"
    radio, nominal = asset.radio, world.radio
    slow = radio.latency_s + radio.jitter_s > nominal.latency_s + nominal.jitter_s
    return "degraded" if slow or radio.loss > nominal.loss else "ok"


def loses(scene: Scene, asset: AssetState) -> bool:
    """Draw whether one message is lost on the way, on a link that works."""
    return asset.radio.loss > 0.0 and scene.rng.random() < asset.radio.loss


def delay(scene: Scene, asset: AssetState, dt_s: float) -> int:
    """Draw how many steps one message takes, at least one."""
    radio = asset.radio
    seconds = radio.latency_s
    if radio.jitter_s > 0.0:
        seconds += radio.jitter_s * scene.rng.random()
    return 1 if seconds <= dt_s else math.ceil(seconds / dt_s - 1e-9)


def set_comms(world: World, asset: AssetState, comms: CommsStatus) -> None:
    """Make the link of `asset` ok, degraded or lost."""
    match comms:
        case "ok":
            asset.radio = RadioState.nominal(world.radio)
        case "degraded":
            asset.radio = DEGRADED
        case "lost":
            asset.radio = RadioState(
                asset.radio.latency_s, asset.radio.jitter_s, asset.radio.loss, up=False
            )


def set_radio(asset: AssetState, values: SetRadio) -> None:
    """Give the link of `asset` these values."""
    asset.radio = RadioState(values.latency_s, values.jitter_s, values.loss, values.up)


def jam(world: World, scene: Scene, area: JamArea) -> None:
    """Jam an area from now on; whoever leaves it has its link again."""
    until = None if area.seconds is None else scene.tick + round(area.seconds / world.dt_s)
    scene.link.jams = (*scene.link.jams, Jam(area.at, area.radius_m, until))


def end_jams(scene: Scene) -> None:
    """Drop the jams whose time is over."""
    if scene.link.jams:
        scene.link.jams = tuple(
            j for j in scene.link.jams if j.until_tick is None or j.until_tick > scene.tick
        )


def _jammed(scene: Scene, asset: AssetState) -> bool:
    return any(
        math.dist(jam.at, asset.position) <= jam.radius_m
        for jam in scene.link.jams
        if jam.until_tick is None or jam.until_tick > scene.tick
    )
