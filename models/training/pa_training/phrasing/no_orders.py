"""Texts that ask the team for nothing: other languages, small talk, code, orders to people.

They are written one by one, a YAML list a category: `{asset}`, `{place}` and `{thing}` are filled
with what the world has, and of `(this|that)` one is taken.
"""

import random
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import yaml

from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.world import World
from pa_training import LANGUAGE
from pa_training.phrasing.names import NameForms
from pa_training.phrasing.phrase_bank import phrase_bank

NOTHING_ASKED = "no order"
"""How a reading says that the words ask the team for nothing."""

_EITHER = re.compile(r"\(([^()]*)\)")
_SLOT = re.compile(r"\{(asset|place|thing)\}")
_PLAIN = 0.15
"""How often a text is typed in small letters, and how often without marks."""


class Text(NamedTuple):
    """One text and the category that it is from."""

    text: str
    kind: str


class NoOrders:
    """Draws texts that ask for nothing, every category as often as any other."""

    def __init__(self, texts: Mapping[str, Sequence[str]]) -> None:
        """Keep `texts` by category; raises ValueError where there are none."""
        self._texts = {kind: list(some) for kind, some in texts.items() if some}
        if not self._texts:
            raise ValueError("there are no texts that ask for nothing")

    @classmethod
    def shipped(cls) -> "NoOrders":
        """Read the lists that come with the phrase banks; raises ValueError for a broken one."""
        return cls.read(LANGUAGE / "nothing")

    @classmethod
    def read(cls, folder: Path) -> "NoOrders":
        """Read every list in `folder`; raises OSError, and ValueError naming file and entry."""
        texts: dict[str, list[str]] = {}
        for file in sorted(folder.glob("*.yaml")):
            found = yaml.safe_load(file.read_text(encoding="utf-8"))
            if not isinstance(found, list):
                raise ValueError(f"{file}: is no list of texts")
            for number, text in enumerate(cast(list[object], found), start=1):
                if not isinstance(text, str) or not text.strip():
                    raise ValueError(f"{file}: entry {number}: is no text")
                texts.setdefault(file.stem, []).append(text)
        return cls(texts)

    def draw(self, rng: random.Random, world: World) -> Text:
        """Return a text about `world`; equal states of `rng` give equal texts."""
        kind = rng.choice([*self._texts])
        names = NameForms(world, phrase_bank().vocabulary)
        said = {
            "asset": lambda: names.say(rng.choice([*world.assets]), rng.randrange(4), rng),
            "place": lambda: names.say(rng.choice([*world.frames]), rng.randrange(4), rng),
            "thing": lambda: rng.choice(("vehicle", "person")),
        }
        text = _EITHER.sub(lambda m: rng.choice(m[1].split("|")), rng.choice(self._texts[kind]))
        text = _SLOT.sub(lambda m: said[m[1]](), text)
        if rng.random() < _PLAIN:
            text = text.lower()
        if rng.random() < _PLAIN:
            text = text.rstrip(".!?")
        return Text(text.strip()[:MAX_MISSION_TEXT] or "...", kind)
