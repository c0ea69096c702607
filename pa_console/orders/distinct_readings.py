"""Which readings of an order ask for something else, and which only say the same otherwise."""

from collections.abc import Iterable
from dataclasses import replace

from pa_console.orders.order import Ask, Reading
from pa_console.orders.reading import read_asked


def distinct(own: str, others: Iterable[str]) -> tuple[str, ...]:
    """Return those of `others` that can be read and ask now for something else than `own`.

    Of those that ask for the same, the first.
    """
    known, kept = [_asks(own)], list[str]()
    for said in others:
        asks = _asks(said)
        if asks is not None and asks not in known:
            known.append(asks)
            kept.append(said)
    return tuple(kept)


def agree(one: str, other: str) -> bool:
    """Whether both readings ask for the same, however it was put; not where one is unreadable."""
    first = _comparable(read_asked(one))
    return first is not None and first == _comparable(read_asked(other))


def _asks(said: str) -> Reading | None:
    """Return what is asked for now, however it was put; None where nothing is gained by asking.

    So it is where that cannot be read, or is all what no order may have, and where somebody is sent
    to where he comes from.
    """
    reading = read_asked(said)
    if reading is None or not reading.readable:
        return None
    if reading.asks and all(ask.task == "refused" for ask in reading.asks):
        return None
    if any(ask.who.origin and ask.who.origin == ask.place for ask in reading.asks):
        return None
    return _comparable(reading)


def _comparable(reading: Reading | None) -> Reading | None:
    if reading is None or not reading.readable:
        return None
    return reading._replace(asks=tuple(map(_without_words, reading.asks)))


def _without_words(ask: Ask) -> Ask:
    """Return `ask` however it was put: whoever a gate has lost, it is the gate that is covered.

    A track is known by its place, and what no order may have is refused whatever it is.
    """
    leaving = "" if ask.task == "cover" else ask.leaving
    return replace(ask, words="", leaving=leaving, track="", track_id="", wrong=None)
