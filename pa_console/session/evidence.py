"""From a decision on a plan to what made it: rules that decided it, telemetry they were given."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from pa_console.schema.finding import Finding
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.session.mission_trace import Attempt

_NAME = re.compile(r"[\w-]+")


@dataclass(frozen=True)
class Evidence:
    """What a plan was decided by: the picture's tick and time, in simulated seconds.

    `deciding` are the findings that stand against it, or all that hold when none does; `facts`
    are lines of telemetry, one for each asset, track and gate that the plan or a finding names.
    """

    tick: int
    time_s: float
    deciding: tuple[Finding, ...]
    facts: tuple[tuple[str, str], ...]


def evidence_of(attempt: Attempt) -> Evidence | None:
    """Return what made the decision on an attempt; None for one that was not rehearsed."""
    if attempt.rehearsal is None or attempt.plan is None:
        return None
    picture = attempt.rehearsal.before
    broken = tuple(finding for finding in attempt.findings if finding.broken)
    held = tuple(finding for finding in attempt.findings if finding.status == "complies")
    texts = [f"{action.agent} {action.command}" for action in attempt.plan.actions]
    texts += [finding.message for finding in broken]
    named = dict.fromkeys(name for text in texts for name in _NAME.findall(text))
    facts = dict(fact for name in named for fact in _facts(name, picture))
    return Evidence(picture.tick, picture.time_s, broken or held, tuple(facts.items()))


def _facts(name: str, picture: Picture) -> Iterator[tuple[str, str]]:
    """Yield what telemetry said of an asset, a track, or a gate and each track there."""
    if name in picture.assets:
        yield name, _asset(picture.assets[name], picture.time_s)
    elif name in picture.tracks:
        yield name, _track(picture.tracks[name], picture.time_s)
    elif name in picture.gates:
        cover = picture.gates[name]
        by = f"covered by {', '.join(cover.by)}" if cover.covered else "not covered"
        there = [track for track in picture.tracks.values() if track.gate == name]
        yield name, f"{by}; tracks: {', '.join(track.id for track in there) or 'none'}"
        yield from ((track.id, _track(track, picture.time_s)) for track in there)


def _asset(asset: AssetTelemetry, now_s: float) -> str:
    parts = [
        f"at {asset.at or 'no frame'}",
        asset.status,
        asset.task,
        f"battery {asset.battery_pct:.0f} %",
        f"link {asset.comms}",
        *(["stale"] if asset.stale else []),
        *(["suspect"] if asset.integrity != "ok" else []),
        f"report {now_s - asset.stamp_s:.1f} s old",
    ]
    return ", ".join(parts)


def _track(track: Track, now_s: float) -> str:
    parts = [
        f"{track.status} at {track.gate}",
        f"identity {track.identity}",
        f"intent {track.intent}",
        "observed" if track.observed else "not observed",
        "warned" if track.warned else "not warned",
        *(["noncombatants suspected"] if track.noncombatants else []),
        f"detected {now_s - track.stamp_s:.1f} s before",
    ]
    return ", ".join(parts)
