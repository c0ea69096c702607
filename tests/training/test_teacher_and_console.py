"""The teacher and the console agree on which orders can be carried out at all."""

import pytest

from pa_console.mission.planning.obstacles import obstacle_to
from pa_training.teacher.roster import Roster, objection
from tests.written import SITUATIONS, given

ALL_DOWN = "whoever could do it is down (CAP-10)"
"""What the console tells of those that nobody names, and the teacher finds while it looks."""


@pytest.mark.parametrize("number", range(2, SITUATIONS, 3))
def test_what_the_teacher_refuses_at_once_the_console_cannot_do(number: int) -> None:
    there, orders = given(number)
    roster = Roster(there.world, there.picture, there.digest)
    for one in orders:
        for ask in one.order.reading.asks:
            why = obstacle_to(ask, there.world, there.picture)
            refused = objection(ask, roster)
            assert why == ALL_DOWN or bool(why) == (refused is not None), (ask.words, why, refused)
