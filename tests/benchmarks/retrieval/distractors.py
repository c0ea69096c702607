"""Makes up rules that use the words of a guarded site but govern none of its missions.

A sentence is: a thing that real rules speak of, of or at some place; what the administration of
the site has to do with it; when or on what occasion. Things and places share their words with
rules about missions (drones, batteries, gates, vehicles, reports); what is done to them is
storing, buying, cleaning, counting, teaching, accounting: never observing, warning, blocking,
moving, covering or reporting on an incident. So they are near in words and far in meaning.
"""

from pathlib import Path
from random import Random
from typing import get_args

from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.schema.rule import PRIORITIES, Domain, Rule


class _Words(StrictModel):
    """The file `distractors.yaml`."""

    class Deed(StrictModel):
        """What is done to a thing, and the tag of rules about it."""

        what: str
        tag: str

    things: tuple[str, ...]
    places: tuple[str, ...]
    deeds: tuple[Deed, ...]
    occasions: tuple[str, ...]


WORDS = Document.read(Path(__file__).with_suffix(".yaml")).parse(_Words)
MOST = len(WORDS.things) * len(WORDS.places) * len(WORDS.deeds) * len(WORDS.occasions)


def distractors(number: int, seed: int = 0) -> tuple[Rule, ...]:
    """Return `number` different rules, the same ones for the same seed.

    Their ids have seven digits, so that they meet none of a rule file. Raises ValueError when
    fewer exist.
    """
    if number > MOST:
        raise ValueError(f"only {MOST} different rules can be made up, not {number}")
    random = Random(seed)
    domains: tuple[Domain, ...] = get_args(Domain)
    return tuple(
        _rule(code, index, random.choice(domains), random)
        for index, code in enumerate(random.sample(range(MOST), number))
    )


def _rule(code: int, index: int, domain: Domain, random: Random) -> Rule:
    code, thing = divmod(code, len(WORDS.things))
    code, place = divmod(code, len(WORDS.places))
    occasion, deed = divmod(code, len(WORDS.deeds))
    what, done = WORDS.things[thing], WORDS.deeds[deed]
    place_and_deed = f"{WORDS.places[place]} {done.what}"
    text = f"{what.capitalize()} {place_and_deed} {WORDS.occasions[occasion]}."
    return Rule(
        id=f"{domain}-{1_000_000 + index}",
        domain=domain,
        priority=random.choice(PRIORITIES[1:]),
        text=text.replace("Uavs", "UAVs").replace("Ugvs", "UGVs"),
        tags=(done.tag, what.lower()),
    )
