"""The incidents of the simulation, and its speed."""

from collections.abc import Iterator

from pa_console.schema import incident as inc
from pa_console.schema.telemetry import Weather
from pa_console.schema.world import World

LOW_BATTERY_PCT = 15.0
JAM_S = 60.0
JAM_FACTOR = 2.0
"""A jammed gate is jammed within this many times its own radius."""

DRIFT_MPS = 1.0
RATES = (1.0, 2.0, 4.0, 8.0)
_WEATHERS: tuple[Weather, ...] = ("fog", "rain", "clear")

WhatIf = tuple[str, inc.Incident]
"""Title and what then happens."""


def next_rate(rate: float, factor: float) -> float:
    """Return the simulation's speed after one step."""
    return min(max(rate * factor, RATES[0]), RATES[-1])


def what_ifs(world: World) -> Iterator[WhatIf]:
    """Yield every incident on offer with its title, the usual ones first."""
    for gate in world.gates:
        yield f"What if: unknown vehicle at {gate}", inc.SpawnTrack(gate=gate)
    for gate in world.gates:
        yield from _visitors(world, gate)
    for weather in _WEATHERS:
        yield f"What if: weather {weather}", inc.SetWeather(weather=weather)
    for camera, spec in world.cameras.items():
        yield f"What if: {camera} of {spec.gate} fails", inc.SensorFault(sensor=camera)
        yield (
            f"What if: {camera} of {spec.gate} works again",
            inc.SensorFault(sensor=camera, works=True),
        )
    for asset in world.assets:
        yield from _asset_troubles(world, asset)
    yield "What if: every link is down", inc.SetRadio(up=False)
    yield (
        "What if: every link works",
        inc.SetRadio(
            latency_s=world.radio.latency_s, jitter_s=world.radio.jitter_s, loss=world.radio.loss
        ),
    )
    yield "What if: the model's worker process is killed", inc.WorkerFault()


def _visitors(world: World, gate: str) -> Iterator[WhatIf]:
    """The contacts and events at a gate."""
    yield (
        f"What if: defiant vehicle at {gate}, goes on when warned",
        inc.SpawnTrack(gate=gate, when_warned="go_on"),
    )
    yield (
        f"What if: hostile vehicle at {gate} that ignores warnings",
        inc.SpawnTrack(gate=gate, intent="hostile", when_warned="go_on"),
    )
    yield f"What if: authorized vehicle at {gate}", inc.SpawnTrack(gate=gate, identity="authorized")
    yield f"What if: person at {gate}", inc.SpawnTrack(gate=gate, track="person", speed_mps=1.4)
    yield (
        f"What if: noncombatants at {gate}",
        inc.SpawnTrack(gate=gate, track="person", speed_mps=1.4, noncombatants=True),
    )
    yield f"What if: false alarm at {gate}", inc.FalseContact(gate=gate)
    frame = world.frames[gate]
    yield (
        f"What if: {gate} is jammed for {JAM_S:g} s",
        inc.JamArea(at=frame.at, radius_m=JAM_FACTOR * frame.radius_m, seconds=JAM_S),
    )
    yield f"What if: tracks at {gate} are gone", inc.ClearTracks(gate=gate)


def _asset_troubles(world: World, asset: str) -> Iterator[WhatIf]:
    """The faults of an asset, and their end."""
    post = world.assets[asset].post
    yield f"What if: {asset} fails", inc.FailAsset(asset=asset)
    yield f"What if: {asset} works again", inc.RestoreAsset(asset=asset)
    yield f"What if: {asset} runs at half speed", inc.DegradeAsset(asset=asset, speed_factor=0.5)
    yield f"What if: {asset} battery low", inc.SetBattery(asset=asset, percent=LOW_BATTERY_PCT)
    yield f"What if: {asset} battery full", inc.SetBattery(asset=asset, percent=100.0)
    yield f"What if: {asset} link degraded", inc.SetComms(asset=asset, comms="degraded")
    yield f"What if: {asset} link lost", inc.SetComms(asset=asset, comms="lost")
    yield f"What if: {asset} link ok", inc.SetComms(asset=asset, comms="ok")
    yield f"What if: {asset} sensor fails", inc.SensorFault(sensor=asset)
    yield f"What if: {asset} sensor works again", inc.SensorFault(sensor=asset, works=True)
    yield (
        f"What if: {asset} telemetry is forged, says it stands at {post}",
        inc.SpoofTelemetry(asset=asset, frame=post),
    )
    yield f"What if: {asset} telemetry is honest again", inc.SpoofTelemetry(asset=asset, frame=None)
    yield f"What if: {asset} position drifts", inc.GpsDrift(asset=asset, rate_mps=DRIFT_MPS)
    yield f"What if: {asset} position is right again", inc.GpsDrift(asset=asset, rate_mps=0.0)
