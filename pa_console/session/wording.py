"""Says in one short line what an incident was, as the event list shows it."""

from pa_console.schema import incident as inc
from pa_console.schema.telemetry import CommsStatus

_LINK: dict[CommsStatus, str] = {"ok": "works", "degraded": "is degraded", "lost": "is lost"}


def in_words(incident: inc.Incident) -> str:
    """Return what an operator could see of `incident`; the truth behind a track stays hidden."""
    match incident:
        case inc.SpawnTrack(track=track, gate=gate):
            return f"a {track} appears on the lane to {gate}"
        case inc.FailAsset(asset=asset):
            return f"{asset} has stopped working"
        case inc.RestoreAsset(asset=asset):
            return f"{asset} works again"
        case inc.SetBattery(asset=asset, percent=percent):
            return f"battery of {asset} reads {percent:g} %"
        case inc.SetComms(asset=asset, comms=comms):
            return f"link of {asset} {_LINK[comms]}"
        case inc.PlaceAsset(asset=asset, frame=frame):
            return f"{asset} is placed at {frame}"
        case inc.ClearTracks(gate=gate):
            return f"all tracks at {gate} are gone"
