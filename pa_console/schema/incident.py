"""External events at the checkpoint: incidents, and scenarios, which are scripts of incidents."""

from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from pa_console.schema.base import Name, NonNegative, Percent, Point, Positive, StrictModel
from pa_console.schema.telemetry import CommsStatus, Identity, Intent, Weather
from pa_console.schema.world import World

Reaction = Literal["leave", "stop", "go_on"]
"""A contact's possible reactions to a warning."""


class SpawnTrack(StrictModel):
    """A vehicle or person appears at the far end of a lane of `gate` and approaches."""

    kind: Literal["spawn"] = "spawn"
    gate: Name
    track: Literal["vehicle", "person"] = "vehicle"
    identity: Identity = Field(default="unauthorized", description="the result of `identify`")
    intent: Intent = Field(default="benign", description="its true intent")
    speed_mps: Positive = 5.0
    distance_m: Positive | None = Field(
        default=None, description="distance from the gate at the start"
    )
    when_warned: Reaction = "leave"
    noncombatants: bool = Field(
        default=False, description="true if there are families, medics or passers-by"
    )
    emergency: bool = Field(
        default=False,
        exclude_if=lambda marked: not marked,
        description="true for an ambulance, a fire engine, or the police",
    )
    name: Name | None = Field(default=None, description="the name by which a scenario refers to it")


class FailAsset(StrictModel):
    """The asset stops working where it is."""

    kind: Literal["fail"] = "fail"
    asset: Name


class RestoreAsset(StrictModel):
    """A failed asset works again."""

    kind: Literal["restore"] = "restore"
    asset: Name


class SetBattery(StrictModel):
    """The charge of the asset's battery is set to `percent`."""

    kind: Literal["battery"] = "battery"
    asset: Name
    percent: Percent


class SetComms(StrictModel):
    """The asset's link becomes ok, degraded or lost."""

    kind: Literal["comms"] = "comms"
    asset: Name
    comms: CommsStatus


class DegradeAsset(StrictModel):
    """The asset continues at reduced speed."""

    kind: Literal["degrade"] = "degrade"
    asset: Name
    speed_factor: float = Field(gt=0.0, le=1.0)


class SetRadio(StrictModel):
    """The link of one asset, or of every asset, gets these values; if not `up`, it is down."""

    kind: Literal["radio"] = "radio"
    asset: Name | None = Field(default=None, description="None means every asset")
    latency_s: NonNegative = 0.05
    jitter_s: NonNegative = 0.05
    loss: float = Field(default=0.0, ge=0.0, le=1.0)
    up: bool = True


class JamArea(StrictModel):
    """Every link within `radius_m` of `at` is jammed, for `seconds` if given, else permanently."""

    kind: Literal["jam"] = "jam"
    at: Point
    radius_m: Positive
    seconds: Positive | None = None


class SensorFault(StrictModel):
    """The sensor of an asset, or the camera of a gate, stops working or works again."""

    kind: Literal["sensor"] = "sensor"
    sensor: Name = Field(description="an asset or a camera")
    works: bool = False


class GpsDrift(StrictModel):
    """The asset's own position estimate drifts from the truth by `rate_mps`; 0 ends the drift."""

    kind: Literal["gps"] = "gps"
    asset: Name
    rate_mps: NonNegative
    heading_deg: float = 0.0


class SpoofTelemetry(StrictModel):
    """Forged reports show the asset at `frame` and without faults; None ends the forgery."""

    kind: Literal["spoof"] = "spoof"
    asset: Name
    frame: Name | None


class DriveByHand(StrictModel):
    """A person takes manual control of the asset, and drives it to `frame` if that is given.

    With `ends`, manual control ends: the asset stays where it is and accepts commands again.
    """

    kind: Literal["manual_control"] = "manual_control"
    asset: Name
    frame: Name | None = None
    ends: bool = False


class SetWeather(StrictModel):
    """A change of weather; rain and fog reduce every sensor's range and detections."""

    kind: Literal["weather"] = "weather"
    weather: Weather


class ObstructWay(StrictModel):
    """An obstruction lies on the ground from `start` to `end`, which no ground asset can pass."""

    kind: Literal["obstruct"] = "obstruct"
    start: Point
    end: Point


class FalseContact(StrictModel):
    """A sensor reports a false contact on a lane of `gate` for `seconds`."""

    kind: Literal["phantom"] = "phantom"
    gate: Name
    seconds: Positive = 20.0


class RevealTrack(StrictModel):
    """The true properties of a contact change; `track` is the name that the script gave it."""

    kind: Literal["turn"] = "turn"
    track: Name
    identity: Identity | None = None
    intent: Intent | None = None
    when_warned: Reaction | None = None


class WorkerFault(StrictModel):
    """The LLM's worker process is killed; nothing in the checkpoint changes."""

    kind: Literal["worker"] = "worker"


class PlaceAsset(StrictModel):
    """The asset is moved to `frame`, its new post, as if it had always been there."""

    kind: Literal["place"] = "place"
    asset: Name
    frame: Name


class ClearTracks(StrictModel):
    """Every track at `gate` disappears."""

    kind: Literal["clear"] = "clear"
    gate: Name


Incident = Annotated[
    SpawnTrack | FailAsset | RestoreAsset | DegradeAsset | SetBattery | SetComms | SetRadio
    | JamArea | SensorFault | GpsDrift | SpoofTelemetry | DriveByHand | SetWeather | ObstructWay
    | FalseContact | RevealTrack | WorkerFault | PlaceAsset | ClearTracks,
    Field(discriminator="kind"),
]  # fmt: skip


def unknown_name(given: StrictModel, world: World) -> tuple[str, str]:
    """Return the field of `given` with a name that `world` lacks, and the problem.

    Returns two empty strings if there is no such field. `given` is an incident or a condition of a
    script. The names that a script gives to tracks are not checked.
    """
    for field in ("asset", "gate", "frame", "sensor"):
        value = getattr(given, field, None)
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


TrackReach = Literal[
    "present", "detected", "observed", "identified", "warned", "stopped", "leaving", "inside",
    "gone",
]  # fmt: skip
AssetReach = Literal["moving", "arrived", "low_battery", "failed", "charging", "silent"]


class TrackIs(StrictModel):
    """A condition: a contact to which the script gave a name has reached a state."""

    track: Name = Field(description="the `name` that the `spawn` gave it")
    state: TrackReach


class AssetIs(StrictModel):
    """A condition: an asset is in a state, and at a frame if one is given."""

    asset: Name
    state: AssetReach
    at: Name | None = None


class After(StrictModel):
    """A condition: another scripted event has happened."""

    event: Name


def _which(value: object) -> str | None:
    """Return the tag of a condition, by the field that only this kind of condition has."""
    fields: Iterable[object] = (
        cast(dict[object, object], value)
        if isinstance(value, dict)
        else (field for field in ("track", "asset", "event") if hasattr(value, field))
    )
    return next((f"<{field}>" for field in fields if field in ("track", "asset", "event")), None)


IncidentCondition = Annotated[
    Annotated[TrackIs, Tag("<track>")]
    | Annotated[AssetIs, Tag("<asset>")]
    | Annotated[After, Tag("<event>")],
    Discriminator(
        _which,
        custom_error_type="condition",
        custom_error_message="a condition must name a track, an asset or an event",
    ),
]


class ScriptedEvent(StrictModel):
    """An event that happens once, at a time or `delay_s` after a condition first holds."""

    name: Name | None = None
    at_s: NonNegative | None = None
    when: IncidentCondition | None = None
    delay_s: NonNegative = 0.0
    do: Incident

    @model_validator(mode="after")
    def _one_trigger(self) -> Self:
        if (self.at_s is None) == (self.when is None):
            raise ValueError("give exactly one of at_s and when")
        return self


class RandomEvents(StrictModel):
    """Incidents at random times: a Poisson process, in which each event is one of `do`."""

    mean_s: Positive = Field(description="mean time between two events, in seconds")
    from_s: NonNegative = 0.0
    do: tuple[Incident, ...] = Field(min_length=1)


class Scenario(StrictModel):
    """A situation for one world, for the console, tests and benchmarks."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9-]*$", max_length=64)
    title: str
    about: str
    duration_s: Positive = 300.0
    events: tuple[ScriptedEvent, ...] = ()
    random: tuple[RandomEvents, ...] = ()

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        names = [event.name for event in self.events if event.name is not None]
        existing = frozenset(names)
        if len(existing) < len(names):
            twice = min(name for name, times in Counter(names).items() if times > 1)
            raise ValueError(f"events: the name {twice!r} is given twice")
        tracks = {e.do.name for e in self.events if e.do.kind == "spawn" and e.do.name}
        for index, event in enumerate(self.events):
            match event.when:
                case After(event=name) if name not in existing:
                    raise ValueError(f"events.{index}.when.event: no event is named {name!r}")
                case TrackIs(track=name) if name not in tracks:
                    raise ValueError(f"events.{index}.when.track: no spawn is named {name!r}")
                case _:
                    pass
        return self
