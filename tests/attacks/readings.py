"""Orders of writers with their true readings, and wrong readings of them."""

import random
import re
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from pa_console.language.canonical.reading import read_asked
from pa_console.language.mention_check import check_mentions
from pa_console.mission.spelling import respell
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.station.assembly import load_site
from pa_training.teacher.teacher import teach
from tests.written import given

_UNLAWFUL = re.compile(
    r"use force|without identification|without warning|with noncombatants|set rules aside"
    r"|without guard|beyond the perimeter"
)
_ALIKE = {
    "respond": ("look", "identify", "warn", "block"), "mass": ("go",), "cover": ("go",),
    "relieve": ("go", "home", "cover"), "go": ("cover",), "stand_down": ("home",),
    "home": ("stand_down",),
}  # fmt: skip
"""Tasks that an order may as well be read as."""


class Example(NamedTuple):
    """An order in words, what it means, and the teacher's plan for it."""

    world: World
    picture: Picture
    text: str
    asked: str
    plan: Plan


def examples(situations: int) -> Iterator[Example]:
    """Yield the orders in so many situations; equal arguments give equal ones."""
    rulebook = load_site("checkpoint", "checkpoint").rulebook
    for number in range(situations):
        there, orders = given(number)
        for one in orders:
            text = respell(one.text, there.world, rulebook)
            try:
                plan = teach(one.order, there.world, there.picture, there.digest).plan
            except (ValueError, LookupError):
                continue
            yield Example(there.world, there.picture, text, one.order.asked, plan)


def wrong(example: Example, rng: random.Random) -> Iterator[tuple[str, str]]:
    """Yield readings in which one thing is another, with what that is; none that are refused."""
    head, now, rest = example.asked.partition("; now: ")
    world, words = example.world, re.findall(r"\w+", head)
    if _UNLAWFUL.search(head):
        return
    for sort, names in (("place", [*world.frames]), ("asset", [*world.assets])):
        if said := [word for word in words if word in names]:
            name = rng.choice(said)
            other = rng.choice([each for each in names if each != name])
            yield sort, re.sub(rf"\b{name}\b", other, head) + now + rest
    if found := re.search(r"(\d+|all|all free) (drone|vehicle|robot)", head):
        other = rng.choice([k for k in ("drone", "vehicle", "robot") if k != found[2]])
        yield "kind", head[: found.start(2)] + other + head[found.end(2) :] + now + rest
    if found := re.search(r"\b(\d+|all) (drone|vehicle|robot)s?\b", head):
        count = rng.choice([n for n in ("1", "2", "3", "4", "all") if n != found[1]])
        team = f"{count} {found[2]}{'' if count == '1' else 's'}"
        yield "number", head[: found.start()] + team + head[found.end() :] + now + rest
    reading = read_asked(head)
    if reading is None or head.startswith("asked: if") or len(reading.asks) != 1:
        return
    ask = reading.asks[0]
    place = ask.place if ask.place in world.frames else rng.choice([*world.frames])
    names = ", ".join(ask.who.names)
    ways = {
        "go": f"{names or 'somebody'} to {place}", "home": f"{names or 'all'} home",
        "hold": f"{names} hold".strip(), "look": f"look at {place}", "block": f"block {place}",
        "warn": f"warn at {place}", "identify": f"identify at {place}", "report": "report",
        "cover": f"cover {place}", "stand_down": f"stand down {place}",
    }  # fmt: skip
    same = (ask.task, *_ALIKE.get(ask.task, ()))
    yield "verb", f"asked: {ways[rng.choice([task for task in ways if task not in same])]}"


class Rates(NamedTuple):
    """Right readings that the check objects to, and wrong ones that it notices, with totals."""

    alarms: int
    right: int
    noticed: Counter[str]
    tried: Counter[str]


def measure(situations: int) -> Rates:
    """Check right and wrong readings."""
    rng = random.Random(7)
    nothing = Plan(reason="", actions=())
    alarms = right = 0
    noticed, tried = Counter[str](), Counter[str]()
    for one in examples(situations):
        right += 1
        alarms += bool(check_mentions(one.world, one.picture, one.text, one.asked, one.plan).gaps)
        for sort, said in wrong(one, rng):
            tried[sort] += 1
            found = check_mentions(one.world, one.picture, one.text, said, nothing)
            noticed[sort] += bool(found.gaps)
    return Rates(alarms, right, noticed, tried)
