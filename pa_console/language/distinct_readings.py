"""The distinct readings of an order: those that lead to other orders."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pa_console.language.order import Ask, Reading, Who
from pa_console.language.reading import read_asked


def distinct(own: str, others: Iterable[str], base: str = "") -> tuple[str, ...]:
    """Return those of `others` that can be read and ask now for something else than `own`.

    Of those that ask for the same, the first. To send somebody to the `base` is to send them home.
    """
    known, kept = [_asks(own, base)], list[str]()
    for said in others:
        asks = _asks(said, base)
        if asks is not None and asks not in known:
            known.append(asks)
            kept.append(said)
    return tuple(kept)


def agree(one: str, other: str, base: str = "") -> bool:
    """Return whether both readings ask for the same; not if one is unreadable."""
    first = _comparable(read_asked(one), base)
    return first is not None and first == _comparable(read_asked(other), base)


def _asks(said: str, base: str) -> Reading | None:
    """Return the asks for now, in any wording; None if asking back gains nothing.

    That is so if they cannot be read, or may not be had at all, or send an asset to its own origin.
    """
    reading = read_asked(said)
    if reading is None or not reading.readable:
        return None
    if reading.asks and all(ask.task == "refused" for ask in reading.asks):
        return None
    if any(ask.who.origin and ask.who.origin == ask.place for ask in reading.asks):
        return None
    return _comparable(reading, base)


def _comparable(reading: Reading | None, base: str) -> Reading | None:
    """Return `reading` however it was put: asks, and the names in each, in one order."""
    if reading is None or not reading.readable:
        return None
    asks = [each for ask in reading.asks for each in _one_by_one(_plainly(ask, base))]
    named = dict.fromkeys(ask for ask in asks if ask.who.names)
    others = (ask for ask in asks if not ask.who.names)
    return reading._replace(asks=tuple(sorted((*named, *others), key=repr)))


def _plainly(ask: Ask, base: str) -> Ask:
    """Return `ask` however it was put: whoever a gate has lost, it is the gate that is covered.

    A track is known by its place, and what no order may have is refused whatever it is.
    """
    leaving = "" if ask.task == "cover" else ask.leaving
    ask = replace(ask, words="", leaving=leaving, track="", track_id="", wrong=None)
    if base and ask.task == "go" and ask.place == base:
        return replace(ask, task="home", place="")
    return ask


def _one_by_one(ask: Ask) -> Iterator[Ask]:
    """Yield the asks of each named asset; those that swap act together."""
    if ask.task == "swap":
        yield replace(ask, who=replace(ask.who, names=tuple(sorted(ask.who.names))))
    elif len(ask.who.names) > 1:
        yield from (replace(ask, who=Who(names=(name,))) for name in ask.who.names)
    else:
        yield ask
