"""One notation where several would mean the same: names as they are said, and in that order.

An order draws its names in some order and words may have them in another: *the two robots, two and
one*. A model cannot guess the order of the draw, and what is learnt of it is noise. Words may say
who is lost or where: *replace Drone_T04* is read as that, for the gate is looked up and not read.
"""

import re
from collections.abc import Mapping, Sequence

from pa_console.language.canonical.reading import asked_words
from pa_console.llm.roles.grammar import PLANNED
from pa_training.order_generator.orders import Order
from pa_training.samples.sample import Sample

_BEGINS = re.compile(r'\{"(reason|feedback)": "')
_BASE = re.compile(r"; base: (\w+)$", re.MULTILINE)
_ASSET = re.compile(r"^(\w+): (?:alone|free|busy|low|down)\b", re.MULTILINE)


def with_names_as_said(sample: Sample, order: Order) -> Sample:
    """Return the `sample` of an `order` with names in its answer's reading as its mission has them.

    To send somebody to the base is written as sending them home. An answer without a reading stays
    as it is.
    """
    begins = _BEGINS.match(sample.answer)
    if begins is None:
        return sample
    said = sample.answer[begins.end() :].partition('"')[0]
    words = said.partition(PLANNED)[0] if PLANNED in said else asked_words(said)
    mission = sample.rest.rpartition("Mission: ")[2]
    base = _BASE.search(sample.system)
    one = _in_order(words, mission, _ASSET.findall(sample.picture))
    one = _who_is_lost(one, mission, _losses(order))
    if base is not None:
        one = re.sub(rf" to {base[1]}(?=[;,:]|$)", " home", one)
    answer = sample.answer[: begins.end()] + one + sample.answer[begins.end() + len(words) :]
    return sample.model_copy(update={"answer": answer})


def _in_order(words: str, mission: str, assets: Sequence[str]) -> str:
    """Return `words` with every list of `assets` in the order in which `mission` has them."""
    one = rf"\b(?:{'|'.join(assets)})\b"
    places = {name: found.start() for name in assets if (found := _found(name, mission))}

    def ordered(listed: re.Match[str]) -> str:
        names = re.findall(one, listed[0])
        if not places.keys() >= {*names}:
            return listed[0]
        there = iter(sorted(names, key=places.__getitem__))
        return re.sub(one, lambda _: next(there), listed[0])

    return re.sub(rf"{one}(?:(?:, | and ){one})+", ordered, words) if assets else words


def _losses(order: Order) -> dict[str, str]:
    """Return the gates that are to be covered for an asset that is lost, with that asset."""
    asks = (*order.asks, *order.otherwise)
    return {ask.place: ask.leaving for ask in asks if ask.task == "cover" and ask.leaving}


def _who_is_lost(words: str, mission: str, losses: Mapping[str, str]) -> str:
    """Return `words` with whom a gate has lost, where `mission` says that."""
    for gate, name in losses.items():
        if _found(name, mission):
            words = re.sub(rf"\bcover {gate}(?= by |[;,]|$)", f"cover {name} at {gate}", words)
    return words


def _found(name: str, mission: str) -> re.Match[str] | None:
    return re.search(rf"\b{name}\b", mission)
