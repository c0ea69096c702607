"""What there is to give orders about, and what an order can depend on."""

import random
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from pa_console.language.canonical.facts import sole_covers
from pa_console.language.canonical.order import Ask, Condition, Fact, Who
from pa_console.schema.telemetry import Digest, Picture, Track
from pa_console.schema.world import KINDS, AssetKind, World
from pa_training.order_generator.orders import is_so

Item = TypeVar("Item")


@dataclass
class View:
    """A situation under a random hand; `named` are the assets that the order speaks of already."""

    rng: random.Random
    world: World
    picture: Picture
    digest: Digest
    named: set[str] = field(default_factory=set[str])

    def some(self, items: Sequence[Item]) -> Item | None:
        """Return one of `items`, None when there is none."""
        return self.rng.choice(items) if items else None

    def chance(self, share: float) -> bool:
        """Return True in that share of cases."""
        return self.rng.random() < share

    def weighted(self, weights: dict[Item, float]) -> Item:
        """Return a key with a probability in proportion to its weight."""
        return self.rng.choices(list(weights), list(weights.values()))[0]

    @property
    def up(self) -> list[str]:
        """The assets that work and that the order does not speak of yet."""
        every = self.picture.assets.values()
        return [a.id for a in every if a.available and a.id not in self.named]

    @property
    def down(self) -> list[str]:
        """The assets that do not work."""
        every = self.picture.assets.values()
        return [a.id for a in every if not a.available and a.id not in self.named]

    @property
    def low(self) -> list[str]:
        """The assets that work and are low on battery."""
        return [name for name in self.up if self.picture.assets[name].low_battery]

    @property
    def tracks(self) -> list[Track]:
        """The tracks that do not leave."""
        return [t for t in self.picture.tracks.values() if t.status != "leaving"]

    @property
    def alone(self) -> list[str]:
        """The assets on which a gate depends."""
        return [name for name in sole_covers(self.picture).values() if name not in self.named]

    def free(self, kind: AssetKind | None = None) -> list[str]:
        """Return the free assets that the order does not speak of yet."""
        kinds = KINDS if kind is None else (kind,)
        return [n for k in kinds for n in self.digest.free[k] if n not in self.named]

    def stands(self, name: str) -> str:
        """Return the frame at which an asset has arrived, '' for none."""
        asset = self.picture.assets[name]
        return asset.at if asset.at is not None and asset.at == asset.post else ""

    def place(self, not_at: Collection[str] = ()) -> str:
        """Return a frame for somebody to go to, a gate more often than not."""
        frames = {name: _WEIGHT[frame.kind] for name, frame in self.world.frames.items()}
        open_frames = {name: w for name, w in frames.items() if name not in not_at} or frames
        for track in self.tracks:
            if track.gate in open_frames:
                open_frames[track.gate] *= 1.7
        return self.weighted(open_frames)

    def gate(self, fits: Callable[[str], bool] | None = None) -> str:
        """Return a gate, one that fits if there is one."""
        good = [gate for gate in self.world.gates if fits is None or fits(gate)]
        return self.rng.choice(good or list(self.world.gates))

    def visited(self, share: float = 0.85) -> str:
        """Return a gate where a track is, in that share of cases, else any gate."""
        track = self.some(self.tracks)
        return track.gate if track is not None and self.chance(share) else self.gate()

    def names(self, pool: Sequence[str], most: int = 3) -> tuple[str, ...]:
        """Return one or a few of `pool`, and note that the order speaks of them."""
        count = min(len(pool), self.rng.choices((1, 2, 3), (75, 20, 5))[0], most)
        chosen = tuple(self.rng.sample(list(pool), count)) if pool else ()
        self.named.update(chosen)
        return chosen

    def team(self, kind: AssetKind, most: int = 3) -> Who:
        """Return a number of a kind, now and then from a frame where such assets stand."""
        count = min(most, self.rng.choices((1, 2, 3), (78, 17, 5))[0])
        homes = [at for name in self.free(kind) if (at := self.stands(name))]
        origin = self.rng.choice(homes) if homes and self.chance(0.12) else ""
        return Who(kind=kind, count=count, origin=origin)


_WEIGHT = {"gate": 5.0, "post": 2.5, "base": 1.0}


FACTS: dict[Fact, float] = {
    "track_at": 4, "no_track_at": 2, "authorized": 1, "unauthorized": 1, "hostile": 1,
    "uncovered": 2, "covered": 2, "low": 2, "not_low": 2, "down": 2, "up": 2,
    "free": 2, "none_free": 1,
}  # fmt: skip
"""How often an order depends on each fact, of all orders under a condition."""
ONE_SIDED = 0.008
"""How often a fact is taken of which the situation knows one answer only."""
_OWN = 0.6
_TRIES = 12


def draw_condition(view: View, ask: Ask) -> Condition | None:
    """Return something that is so as often as not, about what `ask` is about or something else.

    An asset is seldom low and a gate seldom bare: drawn as they come, the fact alone would tell a
    model the answer. None when the situation has too little to ask about.
    """
    for _ in range(_TRIES):
        fact = view.weighted(FACTS)
        every = list(_conditions(fact, view))
        so = [condition for condition in every if is_so(condition, view.picture)]
        sides = [side for side in (so, [c for c in every if c not in so]) if side]
        if len(sides) == 2 or (sides and view.chance(ONE_SIDED)):
            side = view.rng.choice(sides)
            own = [condition for condition in side if _is_about(condition, ask)]
            return view.rng.choice(own if own and view.chance(_OWN) else side)
    return None


def _conditions(fact: Fact, view: View) -> Iterator[Condition]:
    """Yield every condition with `fact` that can be asked in the situation."""
    match fact:
        case "track_at" | "no_track_at":
            for gate in view.world.gates:
                yield Condition(fact=fact, subject=gate)
                yield Condition(fact=fact, subject=gate, track="vehicle")
                yield Condition(fact=fact, subject=gate, track="person")
        case "authorized" | "unauthorized" | "hostile":
            for gate in view.world.gates:
                there = [track for track in view.tracks if track.gate == gate]
                for track in there:
                    yield Condition(fact=fact, subject=gate, track=track.kind)
                if not there:
                    yield Condition(fact=fact, subject=gate, track="vehicle")
        case "uncovered" | "covered":
            for gate in view.world.gates:
                yield Condition(fact=fact, subject=gate)
        case "low" | "not_low" | "down" | "up":
            for name in view.picture.assets:
                yield Condition(fact=fact, subject=name)
        case "free" | "none_free":
            for team in (*KINDS, None):
                yield Condition(fact=fact, kind=team)


def _is_about(condition: Condition, ask: Ask) -> bool:
    """Whether a condition is about the place, an asset or the kind of which `ask` speaks."""
    if condition.kind is not None:
        return condition.kind == ask.who.kind
    return condition.subject in (ask.place, ask.leaving, *ask.who.names)
