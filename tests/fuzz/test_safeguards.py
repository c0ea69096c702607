"""Whatever plan is put to them, the safeguards let none through that breaks an enforced rule."""

import pytest

from tests.fuzz.campaign import campaign

pytestmark = pytest.mark.long


@pytest.mark.parametrize("seed", [11, 12])
async def test_no_drawn_plan_escapes(seed: int) -> None:
    tally = await campaign(150, seed)
    assert tally.escaped == []
    assert tally.executed > 0
    assert tally.refused > 0
