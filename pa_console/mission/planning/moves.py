"""A plan's moves: its agents, their destinations, and the other assets.

The moves follow from the plan's commands and the picture before it, without a simulation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from pa_console.language.canonical.facts import is_free, sole_covers
from pa_console.policy.rule_variables import goes_to
from pa_console.schema.command import ENCOUNTERS, Verb
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture, Track
from pa_console.schema.world import AssetKind, World


@dataclass(frozen=True)
class PlanMoves:
    """The moves of `plan` in the picture `before` it; every agent is an asset of `world`."""

    world: World
    before: Picture
    plan: Plan

    @cached_property
    def goals(self) -> Mapping[str, str]:
        """The destination of each agent that is sent to a place."""
        sent = ((action.agent, goes_to(action, self.world)) for action in self.plan.actions)
        return {agent: goal for agent, goal in sent if goal}

    @cached_property
    def moved(self) -> tuple[str, ...]:
        """The agents that are sent away from their post."""
        return tuple(name for name, goal in self.goals.items() if goal != self.post(name))

    @cached_property
    def alone(self) -> set[str]:
        """The assets that are the only cover of a gate."""
        return {*sole_covers(self.before).values()}

    def kind(self, name: str) -> AssetKind:
        """Return the kind of an asset."""
        return self.world.assets[name].kind

    def post(self, name: str) -> str:
        """Return the post of an asset before the plan; '' if it has none."""
        return self.before.assets[name].post or ""

    def ends(self, name: str) -> str:
        """Return the post of an asset after the plan; '' if it has none."""
        return self.goals.get(name) or self.post(name)

    def free(self, kind: AssetKind | None = None) -> list[str]:
        """Return the assets that could be sent before the plan, of `kind` if given."""
        return [
            name
            for name, asset in self.before.assets.items()
            if kind in (None, asset.kind) and is_free(asset, self.alone)
        ]

    def there(self, place: str, kind: AssetKind) -> list[str]:
        """Return the available assets of a kind that are at a place before the plan."""
        return [
            name
            for name, asset in self.before.assets.items()
            if asset.available and asset.kind == kind and asset.post == place
        ]

    def takes_over(self, name: str) -> bool:
        """Return whether an asset moves to a gate that all the gate's guards leave (WF-03)."""
        guards = {*self.guards(self.ends(name))} - {name} if name in self.moved else set[str]()
        return bool(guards) and guards <= {*self.moved}

    def sent(self, place: str, kind: AssetKind | None = None) -> list[str]:
        """Return the assets that move to a place, of `kind` if given."""
        return [n for n in self.moved if self.ends(n) == place and kind in (None, self.kind(n))]

    def guards(self, place: str) -> tuple[str, ...]:
        """Return the assets that cover a gate before the plan."""
        cover = self.before.gates.get(place)
        return cover.by if cover is not None else ()

    def tracks(self, place: str) -> list[Track]:
        """Return the tracks at a gate, including those that are leaving."""
        return [track for track in self.before.tracks.values() if track.gate == place]

    def commands(
        self, place: str, verbs: Sequence[Verb] = ENCOUNTERS, names: Sequence[str] = ()
    ) -> list[Action]:
        """Return the commands with `verbs` for a place; `names` limits them to these agents."""
        return [
            action
            for action in self.plan.actions
            if action.target == place and action.verb in verbs
            if not names or action.agent in names
        ]

    def dealt_with(self, place: str) -> bool:
        """Return whether an asset observes a place or deals with a contact there."""
        drones = (a.target for a in self.plan.actions if self.kind(a.agent) == "uav")
        return bool(self.commands(place)) or place in drones
