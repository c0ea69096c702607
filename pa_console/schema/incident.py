"""Things that happen to the checkpoint from outside: set-up of missions, scenarios, what-if."""

from typing import Annotated, Literal

from pydantic import Field

from pa_console.schema.base import Name, Percent, Positive, StrictModel
from pa_console.schema.telemetry import CommsStatus, Identity, Intent


class SpawnTrack(StrictModel):
    """A vehicle or person appears at the far end of the lane of `gate` and approaches it."""

    kind: Literal["spawn"] = "spawn"
    gate: Name
    track: Literal["vehicle", "person"] = "vehicle"
    identity: Identity = Field(default="unauthorized", description="what `identify` will find")
    intent: Intent = Field(default="benign", description="the truth behind it")
    speed_mps: Positive = 5.0
    distance_m: Positive | None = Field(default=None, description="start this far from the gate")
    obeys: bool = Field(default=True, description="stops and leaves when warned")


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
    SpawnTrack | FailAsset | RestoreAsset | SetBattery | SetComms | PlaceAsset | ClearTracks,
    Field(discriminator="kind"),
]
