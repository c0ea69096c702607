"""Texts that ask the team for nothing: other languages, small talk, code, orders to people.

They are written one by one, a YAML list a category: `{asset}`, `{place}` and `{thing}` are filled
with what the world has, and of `(this|that)` one is taken.
"""

import random
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple, cast

import yaml

from pa_console.language.name_linking import WORD
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.world import World
from pa_training import LANGUAGE

_EITHER = re.compile(r"\(([^()]*)\)")
_SLOT = re.compile(r"\{(asset|place|thing)\}")
_PLAIN = 0.15
"""The share of texts in small letters, and of those without marks at the end."""


class Text(NamedTuple):
    """One text and the category that it is from."""

    text: str
    kind: str


@cache
def shipped_lists() -> Mapping[str, Sequence[str]]:
    """Return the texts that come with the package, by category."""
    return read_lists(LANGUAGE / "nothing")


def read_lists(folder: Path) -> Mapping[str, Sequence[str]]:
    """Return the texts in `folder` by category; raises OSError, ValueError for a broken list."""
    texts: dict[str, list[str]] = {}
    for file in sorted(folder.glob("*.yaml")):
        listed = yaml.safe_load(file.read_text(encoding="utf-8"))
        if not isinstance(listed, list):
            raise ValueError(f"{file}: is no list of texts")
        for number, text in enumerate(cast(list[object], listed), start=1):
            if not isinstance(text, str) or not text.strip():
                raise ValueError(f"{file}: entry {number}: is no text")
            texts.setdefault(file.stem, []).append(text)
    return texts


def draw_text(rng: random.Random, world: World, lists: Mapping[str, Sequence[str]]) -> Text:
    """Return a text about `world`, of every category as often as of any other.

    Equal states of `rng` give equal texts.
    """
    kind = rng.choice([*lists])
    text = _EITHER.sub(lambda match: rng.choice(match[1].split("|")), rng.choice(lists[kind]))
    things = {
        "asset": [*world.assets],
        "place": [*world.frames],
        "thing": ["vehicle", "person"],
    }
    text = _SLOT.sub(lambda match: _said(rng, rng.choice(things[match[1]])), text)
    if rng.random() < _PLAIN:
        text = text.lower()
    if rng.random() < _PLAIN:
        text = text.rstrip(".!?")
    return Text(text.strip()[:MAX_MISSION_TEXT] or "...", kind)


def _said(rng: random.Random, name: str) -> str:
    """Return a name as it is, or in words."""
    return name if rng.random() < 0.5 else " ".join(WORD.findall(name)).lower()
