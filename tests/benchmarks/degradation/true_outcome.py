"""Follows the truth of a run beside what the station believes, and counts where they part."""

import math
from dataclasses import dataclass, field

from shapely import Point, Polygon

from pa_console.schema.base import StrictModel
from pa_console.schema.events import event as ev
from pa_console.schema.mission import ActionOutcome, Verification
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

STANDOFF_TOLERANCE_M = 0.5
PERIMETER_TOLERANCE_M = 2.0


class RunResult(StrictModel):
    """What one seeded run came to, by the truth."""

    covered: bool
    """No gate was without cover for longer than the grace time."""
    longest_gap_s: float
    missions: int
    plans: int
    halts: int
    passes: int
    fails: int
    unknowns: int
    false_passes: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()
    resent: int = 0


Claim = tuple[Verification, Picture | None]
"""A verification, and the station's picture when its plan was begun."""


@dataclass
class TruthWatch:
    """Collects the true pictures of a run and the claims that the station makes of it."""

    world: World
    _truth: dict[int, Picture] = field(default_factory=dict[int, Picture])
    _claims: list[Claim] = field(default_factory=list[Claim])
    _picture: Picture | None = None
    _start: Picture | None = None
    _halts: int = 0
    _gap: dict[str, float] = field(default_factory=dict[str, float])
    _longest: float = 0.0
    _broken: dict[str, None] = field(default_factory=dict[str, None])
    _ordered: set[str] = field(default_factory=set[str])
    _last: Picture | None = None
    _counts: dict[str, int] = field(default_factory=dict[str, int])

    def see(self, event: ev.Event, sim: Checkpoint) -> None:
        """Take in an event, and the truth as it is now when the event is telemetry."""
        match event.data:
            case ev.TelemetryReceived(picture=picture):
                self._picture = picture
                self._follow(sim.truth())
            case ev.MissionVerified(verification=verification):
                self._claims.append((verification, self._start or self._picture))
                self._start = None
            case ev.DecisionMade(accepted=True):
                self._start = self._picture
            case ev.CommandSent(command=command):
                if command.verb not in ("hold", "report"):
                    self._ordered.add(command.agent)
            case ev.PlanHalted():
                self._halts += 1
                self._start = None
            case _:
                self._counts[event.data.kind] = self._counts.get(event.data.kind, 0) + 1

    def result(self) -> RunResult:
        """Return what the run came to."""
        outcomes = [claim.outcome for claim, _ in self._claims]
        return RunResult(
            covered=self._longest <= self.world.coverage_grace_s,
            longest_gap_s=round(self._longest, 1),
            missions=self._counts.get("mission_finished", 0),
            plans=len(self._claims) + self._halts,
            halts=self._halts,
            passes=outcomes.count("pass"),
            fails=outcomes.count("fail"),
            unknowns=outcomes.count("unknown"),
            false_passes=tuple(
                text
                for claim, start in self._claims
                if claim.outcome == "pass"
                for text in self._lies(claim, start)
            ),
            broken=tuple(self._broken),
            resent=self._counts.get("command_resent", 0),
        )

    def _follow(self, truth: Picture) -> None:
        self._truth[round(truth.time_s * 10)] = truth
        step = 0.0 if self._last is None else truth.time_s - self._last.time_s
        for gate, cover in truth.gates.items():
            gap = 0.0 if cover.covered else self._gap.get(gate, 0.0) + step
            self._gap[gate] = gap
            self._longest = max(self._longest, gap)
        if self._last is not None:
            for name in self._ordered:
                self._look_at(self._last, truth, name)
        self._last = truth

    def _look_at(self, was: Picture, now: Picture, name: str) -> None:
        """Note what an asset under orders did against an enforced rule between two pictures."""
        before, asset = was.assets[name], now.assets[name]
        if before.position == asset.position:
            return
        here = Point(asset.position)
        if Polygon(self.world.perimeter).distance(here) > PERIMETER_TOLERANCE_M:
            self._broken[f"ROE-06 {name}"] = None
        threat = any(t.intent == "hostile" and t.identity != "unknown" for t in now.tracks.values())
        for zone, area in self.world.zones.items():
            shape = Polygon(area.polygon).buffer(-0.5)
            if shape.contains(here) and not shape.contains(Point(before.position)) and not threat:
                self._broken[f"ROE-07 {name} {zone}"] = None
        if asset.kind != "uav":
            self._distance(was, now, before, asset)

    def _distance(
        self, was: Picture, now: Picture, before: AssetTelemetry, asset: AssetTelemetry
    ) -> None:
        least = self.world.standoff_m - STANDOFF_TOLERANCE_M
        for name, contact in now.tracks.items():
            gap = math.dist(asset.position, contact.position)
            closing = gap < math.dist(before.position, contact.position) - 0.05
            known = was.tracks.get(name)
            if gap < least and closing and known is not None and not known.warned:
                self._broken[f"ROE-04 {asset.id} {name}"] = None

    def _lies(self, claim: Verification, start: Picture | None) -> list[str]:
        """Return what a pass claims of its time although it was not so just before nor after."""
        if start is None or not self._truth:
            return []
        as_of = round(claim.as_of_s * 10)
        before = max((time for time in self._truth if time <= as_of), default=min(self._truth))
        after = min((time for time in self._truth if time >= as_of), default=max(self._truth))
        later = self._untrue(claim, start, self._truth[after])
        return [text for text in self._untrue(claim, start, self._truth[before]) if text in later]

    def _untrue(self, claim: Verification, start: Picture, truth: Picture) -> list[str]:
        lost = [
            f"{gate} is not covered"
            for gate, cover in truth.gates.items()
            if start.gates[gate].covered and not cover.covered
        ]
        return lost + [text for a in claim.actions if (text := self._lie(a, truth))]

    def _lie(self, action: ActionOutcome, truth: Picture) -> str:
        asset = truth.assets[action.agent]
        verb, _, target = action.command.partition(" ")
        place = self.world.base if verb == "return_to_base" else target
        if verb in ("move_to", "observe", "block", "return_to_base") and asset.at != place:
            return f"{action.agent} is not at {place}"
        if not asset.available and verb != "report":
            return f"{action.agent} is not available"
        return ""
