"""The premises of a running plan, and the safe way to stop it if a premise breaks (WF-01)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pa_console.mission.rehearse import device_commands
from pa_console.policy.rule_variables import goes_to
from pa_console.schema.command import ENCOUNTERS, DeviceCommand
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Timeline
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World


@dataclass(frozen=True)
class Premises:
    """The picture and the rehearsal on which the approval of a plan is based."""

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
        """Return each premise that `picture` contradicts, in words."""
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
        """Yield the gates that have been without known cover for longer than allowed.

        The limit is the longest gap in the rehearsal plus the world's limit for a lost link. A gate
        that was uncovered when the plan was approved is not yielded.
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
            came = was is None or was.gate != track.gate
            if came and "block" in verbs and self._waits_for_nobody_else(track, picture):
                yield f"{track.id} has come to {track.gate}, which is to be blocked"
            if came and "warn" in verbs and self._would_be_warned_unknown(track, picture):
                yield f"{track.id} has come to {track.gate}, and nobody has identified it"
            if was is not None and (was.intent, was.identity) == (track.intent, track.identity):
                continue
            if track.intent == "hostile" and verbs and "block" not in verbs:
                yield f"{track.id} at {track.gate} is hostile now"
            harmless = track.identity == "authorized" and bool(verbs & {"warn", "block"})
            if harmless or (track.intent == "benign" and "block" in verbs):
                yield f"{track.id} at {track.gate} is {track.identity}, intent {track.intent}"

    def _waits_for_nobody_else(self, track: Track, picture: Picture) -> bool:
        """Return whether a planned block of the track's gate would be directed at it (ROE-02).

        A block that was planned for an empty gate must not meet a later arrival, whose identity is
        unknown. If a warned threat is already there, the block is directed at that threat.
        """
        others = (other for other in picture.tracks.values() if other.id != track.id)
        threat = any(o.gate == track.gate and o.intent == "hostile" and o.warned for o in others)
        return track.status != "leaving" and not threat

    def _would_be_warned_unknown(self, track: Track, picture: Picture) -> bool:
        """Return whether a warning at its gate would address this unidentified track (WF-01).

        If an identified track at the gate has yet to be warned, the warning is for that track.
        """
        if track.identity != "unknown" or track.status == "leaving":
            return False
        there = (o for o in picture.tracks.values() if o.gate == track.gate and not o.warned)
        return all(o.identity == "unknown" or o.status == "leaving" for o in there)


def way_to_safety(plan: Plan, world: World, picture: Picture) -> tuple[Action, ...]:
    """Return the command that each agent gets if `plan` is halted: back to its gate, or hold.

    An agent goes back to a gate if it covers the gate in `picture` and is sent away from it.
    """
    return tuple(
        Action(agent=action.agent, command=f"move_to {home}" if home else "hold")
        for action in plan.actions
        for home in (_left_gate(action, plan, world, picture),)
    )


def ways_to_safety(plan: Plan, world: World, before: Sequence[Picture]) -> tuple[Action, ...]:
    """Return the way to safety for each action of a plan in steps, in the order of the actions.

    `before` has the picture at the start of each rehearsed step. The agents of steps that were not
    rehearsed hold.
    """
    to_safety = [Action(agent=action.agent, command="hold") for action in plan.actions]
    for numbers, picture in zip(plan.steps, before, strict=False):
        ways = way_to_safety(plan.part(numbers), world, picture)
        for number, way in zip(numbers, ways, strict=True):
            to_safety[number - 1] = way
    return tuple(to_safety)


def _left_gate(action: Action, plan: Plan, world: World, picture: Picture) -> str:
    """Return the gate that the agent of `action` leaves; '' if it leaves none.

    If the agent leaves several gates, one that only the plan's agents cover is preferred.
    """
    goal = goes_to(action, world)
    left = [gate for gate, cover in picture.gates.items() if action.agent in cover.by]
    if goal in ("", *left):
        return ""
    alone = (gate for gate in left if not set(picture.gates[gate].by).difference(plan.agents))
    return next(alone, left[0] if left else "")


def safe_state(
    declared: Sequence[Action], picture: Picture, open_agents: Sequence[str], prefix: str
) -> tuple[DeviceCommand, ...]:
    """Return the commands that bring a halted plan's agents to safety.

    They come from the actions `declared` with the plan. Only available agents that are still under
    way get a command. An agent that is to return to its gate holds instead if an asset that is not
    under way covers that gate. The agent's own cover does not count, because the picture may be
    late and still show it at the gate.
    """
    actions: list[Action] = []
    for action in declared:
        if action.agent not in open_agents or not picture.assets[action.agent].available:
            continue
        covering = picture.gates[action.target].by if action.target is not None else ()
        stays = set(covering).difference(open_agents)
        actions.append(Action(agent=action.agent, command="hold") if stays else action)
    return device_commands(Plan(reason="safe state", actions=tuple(actions)), prefix)


def why_lost(asset: AssetTelemetry, picture: Picture) -> str:
    """Return why `asset` is no longer available to the plan; '' if it still is.

    A late report is not a reason, because it would halt every plan on a lossy link.
    """
    if asset.status == "failed":
        return "failed"
    if asset.manual:
        return "came under manual control"
    if asset.battery_pct <= 0.0:
        return "has an empty battery"
    if asset.integrity == "suspect":
        return "sends suspect telemetry"
    if asset.comms == "lost":
        return f"has been silent for {picture.time_s - asset.stamp_s:.0f} s"
    return ""
