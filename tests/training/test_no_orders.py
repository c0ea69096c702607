"""Texts that ask for nothing: lists that can be read and told in any world."""

import random
from pathlib import Path

import pytest

from pa_training.orders.no_orders import draw_text, read_lists, shipped_lists
from pa_training.situations.worlds import shipped_world


def test_a_broken_list_of_texts_is_named(tmp_path: Path) -> None:
    (tmp_path / "talk.yaml").write_text('- "good morning"\n- 3\n', encoding="utf-8")
    with pytest.raises(ValueError, match=r"talk\.yaml: entry 2: is no text"):
        read_lists(tmp_path)


def test_every_shipped_text_can_be_told_in_a_world() -> None:
    rng, world = random.Random(5), shipped_world()
    drawn = [draw_text(rng, world, shipped_lists()) for _ in range(400)]
    assert all(one.text and "{asset}" not in one.text for one in drawn)
    assert len({one.kind for one in drawn}) == 10
