"""What a running plan relies on, whether that still holds, and how to stop it safely (WF-01)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pa_console.orchestrator.rehearsal import device_commands
from pa_console.policy.context import goes_to
from pa_console.schema.command import DeviceCommand
from pa_console.schema.plan import Action, Plan, Verb
from pa_console.schema.rehearsal import Timeline
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import World

ENCOUNTERS: tuple[Verb, ...] = ("observe", "identify", "warn", "block")
"""The commands that deal with whoever is at the gate."""


@dataclass(frozen=True)
class Premises:
    """The picture and the rehearsal on which a plan was approved."""

    world: World
    plan: Plan
    before: Picture
    timeline: Timeline | None

    @property
    def gates(self) -> tuple[str, ...]:
        """The gates that the plan's agents leave or go to."""
        posts = [self.before.assets[a.agent].post for a in self.plan.actions]
        named = {*posts, *(action.target for action in self.plan.actions)}
        return tuple(gate for gate in self.world.gates if gate in named)

    def broken(self, picture: Picture, open_agents: Sequence[str]) -> tuple[str, ...]:
        """Return in words every premise that `picture` contradicts."""
        return (
            *self._lost_agents(picture, open_agents),
            *self._lost_gates(picture),
            *self._changed_tracks(picture, open_agents),
        )

    def _lost_agents(self, picture: Picture, open_agents: Sequence[str]) -> Iterator[str]:
        for agent in open_agents:
            asset = picture.assets.get(agent)
            if asset is None or not self.before.assets[agent].available:
                continue
            if why := why_lost(asset, picture):
                yield f"{agent} {why} on its way"

    def _lost_gates(self, picture: Picture) -> Iterator[str]:
        """Yield the gates that are without known cover for longer than was rehearsed and allowed.

        A gate that had no cover when the plan was approved cannot lose it.
        """
        for gate in self.gates:
            cover, was = picture.gates[gate], self.before.gates[gate]
            if cover.covered or not was.covered:
                continue
            rehearsed = self.timeline.gates[gate].longest_gap_s if self.timeline else 0.0
            allowed = rehearsed + self.world.link_lost_s
            gone = [
                name
                for name in was.by
                if name not in self.plan.agents and why_lost(picture.assets[name], picture)
            ]
            if gone or cover.uncovered_s > allowed:
                by = f": {', '.join(gone)} cannot be counted on" if gone else ""
                word = "its cover is unknown" if cover.unknown else "it is not covered"
                yield f"{gate}: {word}{by}"

    def _changed_tracks(self, picture: Picture, open_agents: Sequence[str]) -> Iterator[str]:
        actions = [a for a in self.plan.actions if a.agent in open_agents]
        for track in picture.tracks.values():
            was = self.before.tracks.get(track.id)
            verbs = {a.verb for a in actions if a.target == track.gate and a.verb in ENCOUNTERS}
            if was is not None and (was.intent, was.identity) == (track.intent, track.identity):
                continue
            if track.intent == "hostile" and verbs and "block" not in verbs:
                yield f"{track.id} at {track.gate} is hostile now"
            harmless = track.identity == "authorized" and bool(verbs & {"warn", "block"})
            if harmless or (track.intent == "benign" and "block" in verbs):
                yield f"{track.id} at {track.gate} is {track.identity}, intent {track.intent}"


def safe_state(
    premises: Premises, picture: Picture, open_agents: Sequence[str], prefix: str
) -> tuple[DeviceCommand, ...]:
    """Return the commands that stop a plan: hold, or back to the gate that would stay uncovered.

    An agent that covered a gate when the plan was approved goes back there unless somebody who
    stays is known to cover it now; every other agent under way holds where it is. Whoever was
    sent away from such a gate goes back even if the picture, which is late, still shows it there.
    """
    goals = {a.agent: goes_to(a, premises.world) for a in premises.plan.actions}
    actions: list[Action] = []
    for agent in open_agents:
        asset = picture.assets[agent]
        if not asset.available:
            continue
        home = next(
            (
                gate
                for gate, cover in premises.before.gates.items()
                if agent in cover.by and not set(picture.gates[gate].by).difference(open_agents)
            ),
            None,
        )
        leaves = home is not None and (asset.at != home or goals.get(agent, "") not in ("", home))
        actions.append(Action(agent=agent, command=f"move_to {home}" if leaves else "hold"))
    return device_commands(Plan(reason="safe state", actions=tuple(actions)), prefix)


def why_lost(asset: AssetTelemetry, picture: Picture) -> str:
    """Return in words why `asset` is lost to the plan, empty when it is not.

    A report that is merely late is none: a lossy link would halt every plan.
    """
    if asset.status == "failed":
        return "failed"
    if asset.battery_pct <= 0.0:
        return "has an empty battery"
    if asset.integrity == "suspect":
        return "sends suspect telemetry"
    if asset.comms == "lost":
        return f"has been silent for {picture.time_s - asset.stamp_s:.0f} s"
    return ""
