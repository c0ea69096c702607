"""Things that happen to the checkpoint from outside: set-up of missions, scenarios, what-if."""

from typing import Annotated, Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Percent, Point, Positive, StrictModel
from pa_console.schema.telemetry import CommsStatus, Identity, Intent, Weather
from pa_console.schema.world import World

Reaction = Literal["leave", "stop", "go_on"]
"""A contact's reaction to a warning."""


class SpawnTrack(StrictModel):
    """A vehicle or person appears at the far end of the lane of `gate` and approaches it."""

    kind: Literal["spawn"] = "spawn"
    gate: Name
    track: Literal["vehicle", "person"] = "vehicle"
    identity: Identity = Field(default="unauthorized", description="what `identify` will find")
    intent: Intent = Field(default="benign", description="the truth behind it")
    speed_mps: Positive = 5.0
    distance_m: Positive | None = Field(default=None, description="start this far from the gate")
    when_warned: Reaction = "leave"
    noncombatants: bool = Field(default=False, description="families, medics, passers-by")
    name: Name | None = Field(default=None, description="a scenario's handle for it")


class FailAsset(StrictModel):
    """The asset stops working where it is."""

    kind: Literal["fail"] = "fail"
    asset: Name


class RestoreAsset(StrictModel):
    """A failed asset works again."""

    kind: Literal["restore"] = "restore"
    asset: Name


class SetBattery(StrictModel):
    """The asset's battery reads `percent` from now on."""

    kind: Literal["battery"] = "battery"
    asset: Name
    percent: Percent


class SetComms(StrictModel):
    """The asset's link becomes ok, degraded or lost."""

    kind: Literal["comms"] = "comms"
    asset: Name
    comms: CommsStatus


class DegradeAsset(StrictModel):
    """The asset goes on at a part of its speed."""

    kind: Literal["degrade"] = "degrade"
    asset: Name
    speed_factor: float = Field(gt=0.0, le=1.0)


class SetRadio(StrictModel):
    """The link of an asset, or of all, gets these values; `up` False is an outage."""

    kind: Literal["radio"] = "radio"
    asset: Name | None = Field(default=None, description="None means every asset")
    latency_s: NonNegative = 0.05
    jitter_s: NonNegative = 0.05
    loss: float = Field(default=0.0, ge=0.0, le=1.0)
    up: bool = True


class JamArea(StrictModel):
    """Every link within `radius_m` of `at` is jammed, for `seconds` or for good."""

    kind: Literal["jam"] = "jam"
    at: Point
    radius_m: Positive
    seconds: Positive | None = None


class SensorFault(StrictModel):
    """The sensor of an asset, or a gate camera, stops working, or works again."""

    kind: Literal["sensor"] = "sensor"
    sensor: Name = Field(description="an asset or a camera")
    works: bool = False


class GpsDrift(StrictModel):
    """The asset's own position drifts away from the truth by `rate_mps`; 0 sets it right."""

    kind: Literal["gps"] = "gps"
    asset: Name
    rate_mps: NonNegative
    heading_deg: float = 0.0


class SpoofTelemetry(StrictModel):
    """Forged reports put the asset, well, at `frame`; None ends the forgery."""

    kind: Literal["spoof"] = "spoof"
    asset: Name
    frame: Name | None


class SetWeather(StrictModel):
    """Rain and fog shorten every sensor's range and make it miss more."""

    kind: Literal["weather"] = "weather"
    weather: Weather


class ObstructWay(StrictModel):
    """Something lies across the ground from `start` to `end`: no ground asset passes."""

    kind: Literal["obstruct"] = "obstruct"
    start: Point
    end: Point


class FalseContact(StrictModel):
    """A sensor reports a contact on the lane of `gate` that is not there, for `seconds`."""

    kind: Literal["phantom"] = "phantom"
    gate: Name
    seconds: Positive = 20.0


class RevealTrack(StrictModel):
    """The truth behind a contact that the script named changes."""

    kind: Literal["turn"] = "turn"
    track: Name
    identity: Identity | None = None
    intent: Intent | None = None
    when_warned: Reaction | None = None


class WorkerFault(StrictModel):
    """The LLM's worker process is killed; nothing in the checkpoint changes."""

    kind: Literal["worker"] = "worker"


class PlaceAsset(StrictModel):
    """The asset stands at `frame`, assigned to it, as if it had been there all along."""

    kind: Literal["place"] = "place"
    asset: Name
    frame: Name


class ClearTracks(StrictModel):
    """Every track at `gate` is gone."""

    kind: Literal["clear"] = "clear"
    gate: Name


Incident = Annotated[
    SpawnTrack | FailAsset | RestoreAsset | DegradeAsset | SetBattery | SetComms | SetRadio
    | JamArea | SensorFault | GpsDrift | SpoofTelemetry | SetWeather | ObstructWay | FalseContact
    | RevealTrack | WorkerFault | PlaceAsset | ClearTracks,
    Field(discriminator="kind"),
]  # fmt: skip


def unknown_name(incident: Incident, world: World) -> tuple[str, str]:
    """Return the field of `incident` that names what `world` lacks and a remedy; ('', '') if none.

    A scenario's own handles of tracks are not names of the world.
    """
    for field in ("asset", "gate", "frame", "sensor"):
        value = getattr(incident, field, None)
        if value is None:
            continue
        names = {
            "asset": world.assets,
            "gate": world.gates,
            "frame": world.frames,
            "sensor": world.assets | world.cameras,
        }[field]
        if value not in names:
            return field, f"there is no {field} {value!r} in this world; known: {', '.join(names)}"
    return "", ""
