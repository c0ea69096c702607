"""Writes the orders that untrained models are shown: short ones, with what they ask.

Equal numbers of groups give equal orders. None is like a mission of a test set, whatever its names.
"""

import random
from collections.abc import Iterator
from pathlib import Path

from pa_console.language.name_linking import link_names
from pa_training.order_generator.orders import canonical_meaning
from pa_training.order_generator.sampler import sample_order
from pa_training.phrasing.phrasing import phrase
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.situations.situations import random_situation
from pa_training.situations.worlds import (
    generated_numbers,
    random_world,
    shipped_missions,
)

ORDERS = 12
"""Orders that are drawn in each situation."""
LONGEST = 90
"""Characters of an order."""
STYLES = ("plain", "terse")
LEFT_OUT = ("partly", "harmless", "if")
"""Kinds of orders that take more than one look."""


def taught_lines(groups: int) -> Iterator[list[str]]:
    """Yield the lines of the file for each of so many situations, each order once."""
    known, forbidden = NearDuplicates(shipped_missions()), generated_numbers(shipped_missions())
    seen: set[str] = set()
    for number in range(groups):
        rng = random.Random(f"taught/train/{number}")
        world = random_world(rng, "train", forbidden)
        there = random_situation(rng, world, history=True)
        lines: list[str] = []
        for _ in range(ORDERS):
            order, kind = sample_order(rng, world, there.picture, there.digest)
            said = phrase(order, world, there.picture, rng, "train")
            text = " ".join(link_names(world, said.text).split())
            clauses = canonical_meaning(order, world)
            short = said.style in STYLES and len(text) <= LONGEST
            several = "; " in clauses and not kind.startswith("compound")
            plain = not (order.injected or several or kind.startswith(LEFT_OUT))
            fresh = [known.keep([said.text], world), known.keep([text])]
            if short and plain and text not in seen and all(map(all, fresh)):
                seen.add(text)
                lines.append(f"{text}\t{clauses}\n")
        yield lines


def write_taught_orders(file: Path, groups: int) -> Iterator[int]:
    """Write `file`, which appears when it is whole; yield how many orders each situation gave."""
    partial = file.with_name(f"{file.name}.partial")
    with partial.open("w", encoding="utf-8") as stream:
        for lines in taught_lines(groups):
            stream.writelines(lines)
            yield len(lines)
    partial.replace(file)
