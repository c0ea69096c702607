"""Who can be sent: the teacher's view of the team, and which gates a set of moves leaves bare."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from pa_console.llm.compact_prompt import asset_state
from pa_console.llm.facts import WORDS
from pa_console.orchestrator.digest import KINDS
from pa_console.schema.telemetry import Digest, Picture, Track
from pa_console.schema.world import AssetKind, World
from pa_console.training.conditions import tracks_at

MOST_TOLD, MOST_OFFERED = 3, 6
"""More names than these are not told with their states, nor one by one, in a reason."""


@dataclass(frozen=True)
class Roster:
    """The team as picture and digest show it; only assets of the digest are ever chosen."""

    world: World
    picture: Picture
    digest: Digest

    def up(self, name: str) -> bool:
        """Whether an asset is there and works."""
        return name in self.picture.assets and self.picture.assets[name].available

    def kind(self, name: str) -> AssetKind:
        """Return the kind of an asset of the world."""
        return self.world.assets[name].kind

    def low(self, name: str) -> bool:
        """Whether its battery is low (CAP-04)."""
        return self.picture.assets[name].low_battery

    def clear(self, name: str) -> bool:
        """Whether its link is good enough for a critical task (CAP-05)."""
        return self.picture.assets[name].comms == "ok"

    def stands(self, name: str) -> str:
        """Return the frame at which an asset has arrived, '' while it is under way."""
        asset = self.picture.assets[name]
        return asset.at if asset.at is not None and asset.at == asset.post else ""

    def alone_at(self, name: str) -> str:
        """Return the gate that only this asset covers, '' for none."""
        sole = (g for g, cover in self.picture.gates.items() if cover.by == (name,))
        return next(sole, "")

    def there(self, place: str, kinds: Iterable[AssetKind] = KINDS) -> list[str]:
        """Return the assets that are up and stand at `place`, kind after kind."""
        return [
            name
            for kind in kinds
            for name in self.digest.posts
            if self.kind(name) == kind and self.up(name) and self.stands(name) == place
        ]

    def free(
        self, kinds: Iterable[AssetKind], used: Collection[str] = (), origin: str = ""
    ) -> list[str]:
        """Return the free assets, kind after kind and best first; poor links come last."""
        pool = [
            name
            for kind in kinds
            for name in self.digest.free.get(kind, ())
            if name not in used and (not origin or self.stands(name) == origin)
        ]
        return sorted(pool, key=lambda name: not self.clear(name))

    def every(self) -> list[str]:
        """Return all assets that are up, as the picture lists them."""
        return [name for name in self.digest.posts if self.up(name)]

    def told(self, names: Sequence[str]) -> str:
        """Return the states of a few assets as the compact picture has them."""
        if len(names) > MOST_TOLD:
            return "all of them"
        return ", ".join(f"{name}: {asset_state(self.digest, name)}" for name in names)

    def whereabouts(self, name: str) -> str:
        """Return where an asset stands or goes, as the compact picture has it."""
        return f"{name}: {self.digest.posts[name].partition(' ')[2]}"

    def offered(self, names: Sequence[str], *, short: bool = False) -> str:
        """Return who is taken of the free ones, begun as the compact picture begins its list."""
        kinds = {self.kind(name) for name in names}
        label = f"Free {WORDS[self.kind(names[0])]}" if len(kinds) == 1 else "Free"
        few = ", ".join(names) if len(names) <= MOST_OFFERED else f"{len(names)} assets"
        return f"{label}: {'only ' if short else ''}{few}"

    def bare(self, goals: Mapping[str, str]) -> tuple[str, ...]:
        """Return the gates that are covered now and by nobody once everybody is at its goal."""
        lost: list[str] = []
        for gate, cover in self.picture.gates.items():
            stays = any(goals.get(name, gate) == gate for name in cover.by)
            if cover.covered and not stays and gate not in goals.values():
                lost.append(gate)
        return tuple(lost)

    def strangers(self, place: str) -> list[Track]:
        """Return the tracks at `place` that are not identified; no warning before that (WF-01)."""
        tracks = self.picture.tracks.values()
        return [track for track in tracks if track.gate == place and track.identity == "unknown"]

    def unseen(self, place: str) -> bool:
        """Whether an unknown track at `place` waits for its first look from the air (WF-02)."""
        return any(not track.observed for track in self.strangers(place))

    def track(self, place: str, kind: str, track_id: str) -> Track | None:
        """Return the track that is meant: by its id, else the most urgent one at `place`."""
        named = self.picture.tracks.get(track_id)
        if named is not None:
            return named
        here = tracks_at(self.picture, place, kind) or tracks_at(self.picture, place)
        return here[0] if here else None
