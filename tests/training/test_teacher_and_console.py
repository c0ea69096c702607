"""The teacher and the console agree on which orders can be carried out at all."""

import random

from hypothesis import given, settings
from hypothesis import strategies as st
from pa_training.order_generator.orders import canonical_clause
from pa_training.order_generator.sampler import sample_order

from pa_console.language.canonical.reading import read_asked
from pa_console.mission.planning.obstacles import obstacle_to
from pa_training.situations.situations import random_situation
from pa_training.situations.worlds import random_world
from pa_training.teacher.roster import Roster, objection

ALL_DOWN = "whoever could do it is down (CAP-10)"
"""What the console tells of those that nobody names, and the teacher finds while it looks."""


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_what_the_teacher_refuses_at_once_the_console_cannot_do(seed: int) -> None:
    rng = random.Random(seed)
    there = random_situation(rng, random_world(rng))
    world, picture, digest = there.world, there.picture, there.digest
    roster = Roster(world, picture, digest)
    for _ in range(8):
        order, _ = sample_order(rng, world, picture, digest)
        for ask in (*order.asks, *order.otherwise):
            if ask.strict_who:
                continue
            words = canonical_clause(ask, world)
            reading = read_asked(f"asked: {words}")
            assert reading is not None
            why = obstacle_to(reading.asks[0], world, picture)
            refused = objection(ask, roster)
            assert why == ALL_DOWN or bool(why) == (refused is not None), (words, why, refused)
