"""The search: attacks are rewritten, and those that came nearest to harm are rewritten again.

Each family has a population of its own. A parent is drawn from the nearest of it or, now and then,
from all, so that the search does not end in one corner. Equal seeds make equal searches.
"""

import random
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

A = TypeVar("A")
MOST_KEPT = 12
"""The attacks of a family that stay in its population, the nearest ones."""
CURIOUS = 0.2
"""The share of parents that are drawn from all of a population and not from its best third."""


@dataclass
class Tally:
    """Tries by family, and the first attack that did each harm."""

    tries: Counter[str] = field(default_factory=Counter[str])
    hits: dict[tuple[str, str], str] = field(default_factory=dict[tuple[str, str], str])

    @property
    def told(self) -> list[str]:
        """The table attack family | tries."""
        rows = [f"{name} | {count}" for name, count in sorted(self.tries.items())]
        return ["attack family | tries", *rows]

    @property
    def amiss(self) -> list[str]:
        """Each harm with the attack that did it."""
        return [f"{family}: {harm}\n    {how}" for (family, harm), how in self.hits.items()]


@dataclass
class _Population(Generic[A]):
    """The attacks of one family with how near each came, the nearest first."""

    kept: list[tuple[float, A]] = field(default_factory=list[tuple[float, A]])

    def parent(self, rng: random.Random) -> A:
        best = self.kept[: max(1, len(self.kept) // 3)]
        return rng.choice(self.kept if rng.random() < CURIOUS else best)[1]

    def take(self, nearness: float, attack: A) -> None:
        if all(attack != known for _, known in self.kept):
            self.kept.append((nearness, attack))
            self.kept.sort(key=lambda item: -item[0])
            del self.kept[MOST_KEPT:]


@dataclass(frozen=True)
class Outcome:
    """How near an attack came to its goal, 0 to 1, and the harms that it did, with how."""

    nearness: float
    harms: dict[str, str]


@dataclass
class Search(Generic[A]):
    """One search over attacks of some families."""

    seeds: list[tuple[str, A]]
    """Family and attack, in the order in which they are tried first."""
    rewrite: Callable[[random.Random, A, list[A]], A]
    """Returns an attack after one rewrite; the last argument is the family's population."""
    judge: Callable[[A], Awaitable[Outcome]]

    async def run(self, seed: int, tries: int) -> Tally:
        """Search until so many tries are made; return what came of them."""
        rng, tally, waiting = random.Random(seed), Tally(), list(self.seeds)
        families = list(dict.fromkeys(family for family, _ in self.seeds))
        populations = {family: _Population[A]() for family in families}
        for made in range(tries):
            if waiting:
                family, attack = waiting.pop(0)
            else:
                family = families[made % len(families)]
                population = populations[family]
                attack = population.parent(rng)
                for _ in range(rng.choice((1, 1, 2, 3))):
                    attack = self.rewrite(rng, attack, [known for _, known in population.kept])
            outcome = await self.judge(attack)
            tally.tries[family] += 1
            for harm, how in outcome.harms.items():
                tally.hits.setdefault((family, harm), f"try {made}: {how}: {attack!r}")
            populations[family].take(outcome.nearness + bool(outcome.harms), attack)
        return tally
