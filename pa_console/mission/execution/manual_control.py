"""Manual control: the assets that a person drives, and the missions that await them."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from pa_console.language.name_linking import named
from pa_console.schema.mission import Mission, MissionStatus
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

UNFINISHED: frozenset[MissionStatus] = frozenset(("held", "unverified", "failed", "refused"))
"""The final statuses of missions that may await assets: not verified, and not ended by an
operator."""


@dataclass(frozen=True)
class AwaitingMission:
    """A mission that ended unfinished, and the assets that it awaits."""

    mission: Mission
    assets: frozenset[str]


class ManualControl:
    """The assets of `world` under manual control, and the missions that await them."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.taken: dict[str, str] = {}
        """The assets whose manual control was taken at this station, each with the person."""
        self._reported: frozenset[str] = frozenset()
        self._awaiting: dict[str, AwaitingMission] = {}

    @property
    def assets(self) -> frozenset[str]:
        """The assets under manual control, taken by an operator or reported by the assets."""
        return self._reported.union(self.taken)

    def refusal(self, asset: str) -> str:
        """Return why no command may be sent to `asset`; '' if it is not under manual control."""
        if asset in self.taken:
            return f"{asset} is under manual control, taken by {self.taken[asset]}"
        return f"{asset} reports manual control" if asset in self._reported else ""

    def take(self, asset: str, by: str) -> None:
        """Record that `by` took `asset`; raises ValueError if it is unknown or already taken."""
        if problem := self.objection(asset, take=True):
            raise ValueError(problem)
        self.taken[asset] = by

    def end(self, asset: str) -> None:
        """Record the end of control of `asset`; raises ValueError if it was not taken here."""
        if problem := self.objection(asset, take=False):
            raise ValueError(problem)
        del self.taken[asset]

    def objection(self, asset: str, *, take: bool) -> str:
        """Return why manual control of `asset` cannot be taken, or ended; '' if it can."""
        if asset not in self._world.assets:
            return f"there is no asset {asset!r}; known: {', '.join(self._world.assets)}"
        if take:
            return f"{self.refusal(asset)} already" if asset in self.taken else ""
        if asset in self.taken:
            return ""
        if asset in self._reported:
            return f"{asset} reports manual control by itself: end it at the asset"
        taken = ", ".join(self.taken) or "no asset"
        return f"{asset} is not under manual control; taken here: {taken}"

    def see(self, picture: Picture) -> frozenset[str]:
        """Process the reports of a picture; return the assets newly under manual control."""
        before = self.assets
        manual = (name for name, asset in picture.assets.items() if asset.manual)
        self._reported = frozenset(manual).difference(self.taken)
        return self.assets - before

    # Missions that await an asset

    def awaits(
        self, mission: Mission, status: MissionStatus, agents: Collection[str]
    ) -> tuple[str, ...]:
        """Record an ended mission if it needs assets under manual control; return these assets.

        A mission needs the `agents` that its plan ordered and the assets that its text names.
        Missions of alarms and standing orders are not recorded, because these start them again.
        """
        is_order = mission.source in ("operator", "agent")
        if status not in UNFINISHED or not is_order or not self.assets:
            return ()
        needed = self.assets.intersection((*agents, *named(self._world.assets, mission.text)))
        if needed:
            self._awaiting[mission.id] = AwaitingMission(mission, needed)
        return tuple(sorted(needed))

    def take_up(self, awaiting: Iterable[tuple[Mission, Collection[str]]]) -> None:
        """Record the missions that awaited assets at the end of the session that is continued."""
        for mission, assets in awaiting:
            self._awaiting[mission.id] = AwaitingMission(mission, frozenset(assets))

    def come_back(self) -> list[AwaitingMission]:
        """Remove and return the missions that await no asset any more, first ended first."""
        back = [mission for mission in self._awaiting.values() if not mission.assets & self.assets]
        for mission in back:
            del self._awaiting[mission.mission.id]
        return back

    def forget(self) -> None:
        """Forget all awaiting missions, because everything was stopped."""
        self._awaiting.clear()

    @property
    def awaiting(self) -> Mapping[str, AwaitingMission]:
        """The missions that await assets, by their ids."""
        return self._awaiting
