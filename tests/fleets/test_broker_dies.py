"""A broker that dies and comes back: no command is carried out twice, and none is lost unsaid."""

import pytest

from pa_console.station.assembly import load_site
from tests.fleets.broker import any_broker
from tests.fleets.bus_campaign import broken_sessions


@pytest.mark.long
async def test_missions_go_on_or_end_with_a_word_while_the_broker_dies() -> None:
    broker = any_broker()
    broker.start()
    try:
        found = await broken_sessions(load_site("checkpoint", "checkpoint"), broker, 1, seed=3)
    finally:
        broker.kill()
    assert found.kills == 1
    assert found.missions
    assert (found.twice, found.lost, found.false) == ([], [], [])
