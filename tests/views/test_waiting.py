"""What is being waited for is told with how long it takes, and how long it usually does."""

from datetime import UTC, datetime
from pathlib import Path

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Metrics, Mission
from pa_console.session.state import SessionState
from pa_console.views.waiting import Waiting, load_usual, save_usual

START = datetime(2026, 3, 1, tzinfo=UTC)


class Session:
    """Missions that go through their steps at times that the test names."""

    def __init__(self, waiting: Waiting) -> None:
        self.state, self.waiting, self.now = SessionState(), waiting, 0.0

    def tell(self, mission: str | None, data: ev.EventPayload, after_s: float = 0.0) -> None:
        """Let `data` happen."""
        self.now += after_s
        event = ev.Event(t=START, tick=0, mission=mission, data=data)
        self.state.apply(event)
        self.waiting.take(event, self.state, self.now)

    def begin(self, name: str) -> None:
        """Begin a mission."""
        mission = Mission(id=name, text="Look there.", created=START)
        self.tell(name, ev.MissionReceived(mission=mission, position=0))
        self.tell(name, ev.MissionStarted())
        self.tell(name, ev.RulesRetrieved(method="m", hits=(), seconds=0.0), 0.1)

    def ask(self, name: str) -> None:
        """Ask the model for its plan."""
        prompt = ev.PromptBuilt(role="planner", attempt=1, system="", user="", seconds=0.0)
        self.tell(name, prompt, 0.1)

    def answer(self, name: str, after_s: float) -> None:
        """Let the model have answered."""
        usage = Usage(completion_tokens=20)
        told = ev.PlanProposed(attempt=1, text="x" * 40, plan=None, error="none", usage=usage)
        self.tell(name, told, after_s)

    def end(self, name: str) -> None:
        """End a mission."""
        self.tell(name, ev.MissionFinished(status="held", reason="", metrics=Metrics()))

    def line(self, after_s: float) -> str:
        """Return what is said so many seconds from now."""
        return self.waiting.line(self.now + after_s, self.state)


def test_a_step_is_named_with_its_time_and_tokens_and_the_usual_time_of_this_session() -> None:
    session = Session(Waiting())
    session.begin("M1")
    session.ask("M1")
    assert session.line(0.1) == ""
    assert session.line(7.0) == "the model writes the plan: 7 s"
    session.answer("M1", 4.0)
    session.end("M1")
    assert session.line(9.0) == ""
    for name, taken in (("M2", 6.0), ("M3", 5.0)):
        session.begin(name)
        session.ask(name)
        session.tell(name, ev.TextStreamed(role="planner", attempt=1, text="y" * 20))
        told = session.line(2.0)
        session.answer(name, taken)
        session.end(name)
    assert told == "the model writes the plan: 2 s, usually 5.0 s, 10 tokens"
    assert session.waiting.usual_s("plan") == 5.0


def test_what_earlier_sessions_took_is_the_usual_time_at_first(tmp_path: Path) -> None:
    kept = tmp_path / "state" / "usual.json"
    assert load_usual(kept, "model") == {}
    save_usual(kept, "model", {"plan": 8.0, "decide": 99.0})
    assert load_usual(kept, "model") == {"plan": 8.0}
    assert load_usual(kept, "another") == {}
    session = Session(Waiting(load_usual(kept, "model")))
    session.begin("M1")
    session.ask("M1")
    assert session.line(1.0) == "the model writes the plan: 1 s, usually 8.0 s"
    kept.write_text("[")
    assert load_usual(kept, "model") == {}


def test_nothing_is_waited_for_while_the_operator_decides() -> None:
    session = Session(Waiting())
    assert session.line(5.0) == ""
    session.begin("M1")
    from tests.tui import story  # noqa: PLC0415

    asked = next(d for d in story.told("approval") if isinstance(d, ev.ApprovalRequested))
    session.tell("M1", asked)
    assert session.line(60.0) == ""


def test_after_the_verdict_it_is_the_second_reader_that_is_waited_for() -> None:
    session = Session(Waiting())
    session.begin("M1")
    session.tell("M1", ev.PromptBuilt(role="judge", attempt=1, system="", user="", seconds=0.0))
    assert session.line(4.0) == "the judge reads the plan: 4 s"
    session.tell("M1", ev.PlanJudged(attempt=1, verdict=None, error="none"), 4.0)
    assert session.line(2.0) == "the second reader reads the order: 2 s"
    read = ev.OrderReadAgain(attempt=1, model="m", asked="", error="no answer within 15 s")
    session.tell("M1", read, 15.0)
    assert session.line(1.0) == "the readings of the order are compared: 1 s"


def test_a_plan_that_is_carried_out_takes_as_long_as_it_was_rehearsed_to() -> None:
    from tests.tui import story  # noqa: PLC0415

    session = Session(Waiting({"execute": 7.7}))
    for told in story.told("executing"):
        session.tell(story.MISSION.id, told)
    seconds = story.rehearsal().timeline.duration_s
    assert session.line(3.0) == f"the assets carry out the plan: 3 s of about {seconds:.0f} s"


def test_a_step_that_was_not_waited_for_has_no_usual_time() -> None:
    assert Waiting({"plan": 0.0, "judge": 2.0}).usual == {"judge": 2.0}
