"""From a rule to the missions in which it was retrieved, decided or broken."""

from pa_console.session.state.fold import SessionState
from pa_console.session.state.rule_trail import uses_of
from tests.tui import story


def missions(*broken: str) -> SessionState:
    state = SessionState()
    for event in story.stamped(story.told("approval", broken=broken)):
        state.apply(event)
    return state


def test_a_rule_is_followed_to_its_missions() -> None:
    traces = missions("WF-03").missions.values()
    (use,) = uses_of("WF-03", traces)
    assert use.mission == story.MISSION.id
    assert use.hit is not None
    assert use.hit.score == 0.38
    assert [(number, found.status) for number, found in use.decided] == [(1, "violates")]
    assert use.broken
    (judged,) = uses_of("ROE-01", traces)
    assert judged.hit is not None
    assert judged.hit.pinned
    assert not judged.decided
    (checked,) = uses_of("CAP-01", traces)
    assert checked.hit is None
    assert not checked.broken
    assert uses_of("WF-09", traces) == ()
