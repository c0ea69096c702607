"""An attempt as Markdown tells what the operator could read before deciding."""

from pa_console.export.markdown_attempt import attempt_parts
from pa_console.session.fold import SessionState
from tests.tui import story


def test_what_of_the_order_is_not_met_stands_under_the_plan() -> None:
    unmet = ("1 drone to WestGate: nobody can be spared",)
    state = SessionState()
    for event in story.stamped(story.told("approval", unmet=unmet)):
        state.apply(event)
    assert state.current is not None
    told = list(attempt_parts(state.current.attempts[0], {}))
    plan, checks = told.index("### Plan"), told.index("### Checks")
    assert any(unmet[0] in part for part in told[plan:checks])
