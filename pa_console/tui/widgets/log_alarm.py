"""The red line on every screen of a console whose session log cannot be written."""

from textual.app import RenderResult
from textual.content import Content
from textual.reactive import reactive
from textual.widget import Widget

CLOSED = "LOG NOT WRITTEN: nothing is dispatched, no plan can be approved"


class LogAlarm(Widget):
    """Shows the consequence for the operator, and then why the log cannot be written."""

    problem: reactive[str] = reactive("", layout=True)

    def __init__(self, problem: str) -> None:
        """`problem` is the log's own text."""
        super().__init__()
        self.set_reactive(LogAlarm.problem, problem)

    def render(self) -> RenderResult:
        """Show the line."""
        return Content.assemble((f"■ {CLOSED}", "bold"), f". {self.problem}")
