"""A definite description, and which gates or assets of the picture fit it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.language.references.scene import Scene

Sort = Literal["gate", "asset"]
Trait = Callable[[Scene, str], bool]
"""Returns whether a thing of that name has the trait."""
By = Literal["near", "far", "full", "flat"]
"""The measure of a superlative: distance to a place, or from it, or the battery."""
_TIE: dict[By, float] = {"near": 3.0, "far": 3.0, "full": 1.0, "flat": 1.0}
"""Two that are so little apart, in metres or percent, answer to a superlative equally well."""


@dataclass(frozen=True)
class Ranking:
    """A superlative: of those that fit, the one that comes first is meant."""

    by: By
    place: str = ""
    """The origin of distances: a frame or an asset; '' if it is not given."""

    @property
    def distance(self) -> bool:
        """True if it is about distances."""
        return self.by in ("near", "far")

    def measure(self, scene: Scene, name: str) -> float:
        """Return the smaller the better how a thing answers to it, metres or percent."""
        match self.by:
            case "near":
                return scene.distance_m(self.place, name)
            case "far":
                return -scene.distance_m(self.place, name)
            case "full":
                return -scene.asset(name).battery_pct
            case "flat":
                return scene.asset(name).battery_pct


@dataclass(frozen=True)
class Description:
    """Words from the character `start` up to `end` that describe gates or assets.

    So many are meant as `number` says: 0 for all that fit. Of several that fit, `any_will_do`.
    `place` is named inside of it.
    """

    start: int
    end: int
    said: str
    sort: Sort
    traits: tuple[Trait, ...] = ()
    ranking: Ranking | None = None
    number: int = 1
    any_will_do: bool = False
    place: str = ""
    partitive: bool = False
    """True if it only gives the group for a later description."""


def fitting(scene: Scene, description: Description) -> tuple[str, ...]:
    """Return the names of what fits, in the order of the world; a superlative leaves the best.

    Of several that are equally good all are returned.
    """
    names: Sequence[str] = (
        scene.gates if description.sort == "gate" else tuple(scene.picture.assets)
    )
    fit = [name for name in names if all(trait(scene, name) for trait in description.traits)]
    ranking = description.ranking
    if ranking is None or not fit:
        return tuple(fit)
    best = min(ranking.measure(scene, name) for name in fit)
    return tuple(n for n in fit if ranking.measure(scene, n) <= best + _TIE[ranking.by])
