"""The orders given in this session so far, which later orders may refer to."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from pa_console.language.references.scene import Move, PastMission, Scene, after
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

MOST_REMEMBERED = 20
"""The number of missions remembered; orders refer to the last ones."""


@dataclass
class PastOrders:
    """The operator's missions that came to a plan, the latest last, and the mark on the screen.

    The station keeps it; every mission that ends adds to it.
    """

    missions: list[PastMission] = field(default_factory=list[PastMission])
    pointer: str = ""
    """The asset, gate or track that the operator has marked; '' for none."""

    def scene(self, world: World, picture: Picture) -> Scene:
        """Return what an order can point at in `picture`."""
        return Scene(world, picture, tuple(self.missions), self.pointer)

    def remember(
        self, mission: Mission, moves: Iterable[Move], *, undid: bool, corrects: bool
    ) -> None:
        """Add a mission of the operator's; one for which nothing was ordered is not spoken of."""
        first: dict[str, Move] = {}
        for move in moves:
            before = first.setdefault(move.agent, move).before
            first[move.agent] = Move(move.agent, move.verb, move.target, before)
        if mission.source != "operator" or not first:
            return
        past = PastMission(mission.text, tuple(first.values()), undid)
        self.missions.append(after(self.missions, past, corrects=corrects))
        del self.missions[:-MOST_REMEMBERED]


def ordered_by(plan: Plan, picture: Picture) -> tuple[Move, ...]:
    """Return the orders of a plan, with each asset's post in `picture`."""
    return tuple(
        Move(action.agent, action.verb, action.target or "", _place(picture, action.agent))
        for action in plan.actions
    )


def _place(picture: Picture, name: str) -> str:
    asset = picture.assets.get(name)
    return "" if asset is None else asset.post or asset.at or ""
