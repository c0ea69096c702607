"""Makes up rules that use the words of a guarded site but govern none of its missions.

A sentence is: a thing that real rules speak of, of or at some place; what the administration of
the site has to do with it; when or on what occasion. Things and places share their words with
rules about missions (drones, batteries, gates, vehicles, reports); what is done to them is
storing, buying, cleaning, counting, teaching, accounting: never observing, warning, blocking,
moving, covering or reporting on an incident. So they are near in words and far in meaning.
"""

from random import Random
from typing import get_args

from pa_console.schema.rule import PRIORITIES, Domain, Rule

THINGS = (
    "UAVs", "drones", "spare drones", "UGVs", "ground robots", "retired robots", "vehicles",
    "visitors' vehicles", "trucks of suppliers", "batteries", "low batteries", "sensors",
    "cameras", "radio sets", "gate barriers", "checkpoint lamps", "perimeter fences",
    "map frames on posters", "incident report forms", "mission logs", "warning signs",
    "verbal warning recordings", "restricted zone signs", "standoff markers", "identity cards",
    "threat posters", "surveillance monitors", "communications masts", "reserve tents",
    "authorization stamps", "operator handbooks", "safety helmets", "civilian guests' badges",
    "observation towers", "reconnaissance trophies", "base kitchens", "task boards",
    "evidence boxes", "force protection manuals", "patrol boots",
)  # fmt: skip
PLACES = (
    "at the north gate", "at the south gate", "at the east gate", "at the west gate",
    "of the base workshop", "of the night crew", "of the day crew", "in the depot",
    "of the training school", "outside the canteen", "inside the checkpoint hut",
    "of contractors", "under warranty", "on loan", "older than five years", "in the reserve store",
    "near the fuel pumps", "of the visitors' centre", "bought this year", "of the museum",
    "with a serial number", "without a serial number", "in transit", "of the reserve company",
    "of the fire brigade",
)  # fmt: skip
DEEDS: tuple[tuple[str, str], ...] = (
    ("must be counted by the quartermaster", "inventory"),
    ("are washed with clear water only", "cleaning"),
    ("must not be painted without a colour card", "paint"),
    ("are insured for their full price", "insurance"),
    ("are charged to the cost centre that uses them", "accounting"),
    ("must carry a label in both languages", "labels"),
    ("are stored on dry shelves", "storage"),
    ("may be sold only by auction", "sales"),
    ("must be entered in the asset register", "register"),
    ("are photographed for the yearbook", "yearbook"),
    ("must be ordered at least six weeks ahead", "purchase"),
    ("are weighed before they are shipped", "shipping"),
    ("may be lent to schools", "loans"),
    ("are wrapped in paper during building work", "building"),
    ("must be unplugged by the caretaker", "electricity"),
    ("are shown to new employees", "training"),
    ("must be dusted by the cleaning company", "cleaning"),
    ("are depreciated over four years", "accounting"),
    ("may be decorated with flags", "ceremony"),
    ("must be recycled by a certified company", "recycling"),
    ("are numbered from left to right", "labels"),
    ("must be described in the purchase contract", "contract"),
    ("are repaired by the manufacturer", "repair"),
    ("may be named after donors", "donors"),
    ("must be covered with tarpaulins", "weather"),
    ("are listed in the telephone directory", "directory"),
    ("must be tested for lead paint", "health"),
    ("are returned to the supplier", "supplier"),
    ("may be replaced by used ones", "purchase"),
    ("must be locked away by the janitor", "storage"),
)
OCCASIONS = (
    "before the monthly inventory", "after each public holiday", "on the first Monday of a month",
    "at the end of the financial year", "during the summer leave", "unless the store is full",
    "when the price list changes", "if the invoice is missing", "while the canteen is closed",
    "before an open day", "after the annual parade", "once a quarter", "at all times of the year",
    "without extra pay", "if the caretaker is ill", "before winter", "after a move of offices",
    "unless the finance office objects", "during audits", "until the lease ends",
    "with two signatures", "whenever a contract is renewed", "in the presence of an auditor",
    "as soon as stocks are low", "when the museum asks for them", "if the colour has faded",
    "before they are handed to the successor", "after the spring cleaning",
    "unless the union disagrees", "within ten working days",
)  # fmt: skip
MOST = len(THINGS) * len(PLACES) * len(DEEDS) * len(OCCASIONS)


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
    code, thing = divmod(code, len(THINGS))
    code, place = divmod(code, len(PLACES))
    occasion, deed = divmod(code, len(DEEDS))
    what, tag = DEEDS[deed]
    text = f"{THINGS[thing].capitalize()} {PLACES[place]} {what} {OCCASIONS[occasion]}."
    return Rule(
        id=f"{domain}-{1_000_000 + index}",
        domain=domain,
        priority=random.choice(PRIORITIES[1:]),
        text=text.replace("Uavs", "UAVs").replace("Ugvs", "UGVs"),
        tags=(tag, THINGS[thing].lower()),
    )
