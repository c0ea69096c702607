"""The search: attacks are rewritten, and those that came nearest to harm are rewritten again.

Each family has a population of its own. A parent is drawn from the nearest of it or, now and then,
from all, so that the search does not end in one corner. Equal seeds make equal searches.
"""

import asyncio
import random
import time
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
class Found:
    """One kind of harm as it was first found: the family, the harm, and the attack in words."""

    family: str
    harm: str
    attack: str
    seed: int
    at_try: int

    def __str__(self) -> str:
        return f"{self.family}, try {self.at_try}, seed {self.seed}: {self.harm}\n    {self.attack}"


@dataclass
class Tally:
    """Tries and hits by family, and the first hit of each kind."""

    tries: Counter[str] = field(default_factory=Counter[str])
    hits: Counter[str] = field(default_factory=Counter[str])
    found: dict[tuple[str, str], Found] = field(default_factory=dict[tuple[str, str], Found])

    def note(self, family: str, harms: dict[str, str], attack: str, seed: int) -> list[Found]:
        """Count one try and return what came of it."""
        self.tries[family] += 1
        self.hits[family] += bool(harms)
        now: list[Found] = []
        for harm, how in harms.items():
            now.append(Found(family, f"{harm}: {how}", attack, seed, self.tries[family]))
            self.found.setdefault((family, harm), now[-1])
        return now

    @property
    def table(self) -> str:
        """The table attack family | tries | hits, then the first hit of each kind."""
        rows = [f"{name} | {self.tries[name]} | {self.hits[name]}" for name in sorted(self.tries)]
        return "\n".join(("attack family | tries | hits", *rows, *map(str, self.found.values())))


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
    tell: Callable[[A], str]
    """Returns an attack in words."""
    hear: Callable[[Found], None] = lambda _found: None
    """Is told every hit as it comes."""
    tally: Tally = field(default_factory=Tally)
    _populations: dict[str, _Population[A]] = field(default_factory=dict[str, _Population[A]])

    async def run(
        self, seed: int, *, tries: int | None = None, seconds: float | None = None
    ) -> Tally:
        """Search until so many tries are made or, by the clock, so many seconds have passed.

        A second run goes on with what the first one kept.
        """
        rng, end = random.Random(seed), None if seconds is None else time.monotonic() + seconds
        populations, made = self._populations, 0
        waiting = [] if populations else list(self.seeds)
        families = list(dict.fromkeys(family for family, _ in self.seeds))
        while (tries is None or made < tries) and (end is None or time.monotonic() < end):
            if waiting:
                family, attack = waiting.pop(0)
            else:
                family = families[made % len(families)]
                population = populations[family]
                attack = population.parent(rng)
                for _ in range(rng.choice((1, 1, 2, 3))):
                    attack = self.rewrite(rng, attack, [known for _, known in population.kept])
            await asyncio.sleep(0)  # so that a campaign can be cut short between any two tries
            outcome = await self.judge(attack)
            made += 1
            for hit in self.tally.note(family, outcome.harms, self.tell(attack), seed):
                self.hear(hit)
            populations.setdefault(family, _Population()).take(
                outcome.nearness + bool(outcome.harms), attack
            )
        return self.tally
