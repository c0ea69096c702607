"""Which mission of a session log is meant."""

import pytest

from pa_console.export.source_log import choose_mission
from pa_console.session.mission_trace import MissionTrace
from tests.tui.story import MISSION

MISSIONS = {
    name: MissionTrace(MISSION.model_copy(update={"id": name}))
    for name in ("M001-8849", "M002-1a2b", "M002-77aa")
}


@pytest.mark.parametrize("wanted", ["M001", "M001-8849", "M002-7"])
def test_a_mission_is_named_by_the_begin_of_its_id(wanted: str) -> None:
    assert choose_mission(MISSIONS, wanted).mission.id.startswith(wanted)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [("M002", "choose one of M002-1a2b, M002-77aa"), ("M9", "no such"), ("", "no such")],
)
def test_what_names_no_mission_or_several_is_an_error(wanted: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        choose_mission(MISSIONS, wanted)
