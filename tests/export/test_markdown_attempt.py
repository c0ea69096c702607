"""An attempt as Markdown tells what the operator could read before deciding."""

from pa_console.export.markdown import attempt_parts
from pa_console.session.state.fold import SessionState
from tests.tui import story


def under_the_plan(**options: object) -> str:
    state = SessionState()
    for event in story.stamped(story.told("approval", **options)):
        state.apply(event)
    assert state.current is not None
    told = list(attempt_parts(state.current.attempts[0], {}))
    return "\n".join(told[told.index("### Plan") : told.index("### Checks")])


def test_what_of_the_order_is_not_met_stands_under_the_plan() -> None:
    unmet = "1 drone to WestGate: nobody can be spared"
    assert unmet in under_the_plan(unmet=(unmet,))


def test_that_the_order_may_be_misread_stands_under_the_plan() -> None:
    assert "read with 41% confidence" in under_the_plan(confidence=0.41)
    assert "Unsure" not in under_the_plan(confidence=0.9)
