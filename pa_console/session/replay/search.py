"""Finds words in the texts of a recording, as logged or listed; telemetry is left out."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

from pa_console.session.replay.recording import Recording
from pa_console.session.wording import event_in_words

AROUND = 60
"""Characters of the text that are shown with a hit."""
_REWORDED = tuple(f'"{kind}"' for kind in ("decision_made", "incident", "plan_checked"))
"""Kinds of which lists say more than stands in the log: that the judge was overridden."""


@dataclass(frozen=True)
class Hit:
    """An event that says all the words; `excerpt` is where the first one stands in it."""

    index: int
    mission: str
    kind: str
    excerpt: str


def search(recording: Recording, text: str, first: int, end: int) -> Iterator[Hit]:
    """Yield the events from `first` up to `end` that say every word of `text`, in any case.

    Raises LogError when the log cannot be read any more.
    """
    words = text.lower().split()
    needles = [json.dumps(word, ensure_ascii=False)[1:-1] for word in words]
    if not words:
        return
    for index in recording.timeline.told(first, end):
        line = recording.said(index)
        lowered = line.lower()
        reworded = any(kind in line for kind in _REWORDED)
        if reworded or all(needle in lowered for needle in needles):
            fields = json.loads(line)
            told = [fields["kind"], fields["mission"] or "", *_texts(fields["data"])]
            if reworded:
                told.append(event_in_words(recording[index].data))
            if all(any(word in part.lower() for part in told) for word in words):
                yield Hit(index, told[1], told[0], _excerpt(told, words[0]))


def _texts(value: object) -> Iterator[str]:
    """Yield every text in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for part in cast(dict[str, object], value).values():
            yield from _texts(part)
    elif isinstance(value, list):
        for part in cast(list[object], value):
            yield from _texts(part)


def _excerpt(told: list[str], word: str) -> str:
    """Return what stands around `word`, in the longest text that has it."""
    text = max((part for part in told if word in part.lower()), key=len)
    flat = " ".join(text.split())
    at = max(flat.lower().find(word), 0)
    first = max(at - AROUND // 3, 0)
    return ("…" if first else "") + flat[first : first + AROUND]
