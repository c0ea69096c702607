"""The entry of an operator's words: a mission for the queue, or a change with immediate effect."""

from collections.abc import Callable

from pa_console.language.orders.order_changes import ManualWords, OrderChange, read_manual
from pa_console.language.questions import Question
from pa_console.language.references.conversation import Unclear, corrects
from pa_console.language.references.scene import ReferenceScene
from pa_console.mission.context import Services
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Metrics, Mission
from pa_console.station.answers.answering import IS_QUESTION
from pa_console.station.control import ManualAssets, StandingControl
from pa_console.station.intake import IS_STOPPED, ReadText, read_text
from pa_console.station.worker import MissionWorker, StationParts


class OrderEntry:
    """The entry of the operator's orders, and the control over the waiting missions.

    A text is read only once, although a front end asks whether it is a question before it submits
    it.
    """

    def __init__(  # noqa: PLR0917
        self,
        parts: StationParts,
        worker: MissionWorker,
        services: Callable[[], Services],
        manual: ManualAssets,
        standing: StandingControl,
        require_writable: Callable[[], None],
    ) -> None:
        """Read texts with the rules in force, which `services` returns."""
        self._intake, self._emit, self._worker = parts.intake, parts.emit, worker
        self._services, self._require_writable = services, require_writable
        self._manual, self._standing = manual, standing
        self._last_read: tuple[tuple[str, ReferenceScene, Rulebook], ReadText] | None = None

    def read(self, text: str) -> ReadText:
        """Read a text; if text and situation are the same as in the last call, reuse the result."""
        services = self._services()
        now = (text, services.scene, services.rulebook)
        if self._last_read is None or self._last_read[0] != now:
            self._last_read = now, read_text(*now)
        return self._last_read[1]

    def question_in(self, text: str) -> Question | None:
        """Return the question about the record in `text`; None if it is an order."""
        return self.read(text).question

    def mission_in(self, text: str) -> ReadText | None:
        """Return `text` as read; None for a question or a change with immediate effect."""
        order = self.read(text)
        return order if order.question is None and self._change_in(order) is None else None

    def submit(self, text: str) -> Mission:
        """Queue a mission (paper, Step 1); raises ValueError if it is not accepted.

        A question about the record is not accepted. A change with immediate effect is carried out
        and recorded as a mission.
        """
        self._require_writable()
        order = self.read(text)
        change = self._change_in(order)
        if isinstance(change, Unclear):
            raise ValueError(change.question)
        if change is not None:
            return self._change(order, change)
        if self._services().gate.stopped:
            raise ValueError(IS_STOPPED)
        if order.question is not None:
            raise ValueError(IS_QUESTION)
        if correction := self._corrected(order):
            withdrawn = Decision(kind="reject", reason=f"corrected: “{order.typed}”")
            self._worker.decide(withdrawn)
            if correction == "takes back":
                return self._done_at_once(order, "the waiting plan is withdrawn")
        return self._queue(order, active=self._worker.busy)

    def offer(self, text: str) -> None:
        """Queue a text that the operator did not type, for the operator's decision."""
        self._queue(self.read(text), active=False, offered=True)

    def move(self, mission_id: str, by: int) -> None:
        """Move a waiting mission by `by` places; raises ValueError if it does not wait."""
        self._reorder(lambda: self._intake.move(mission_id, by))

    def defer(self, mission_id: str) -> None:
        """Move a waiting mission behind all others; raises ValueError if it does not wait."""
        self._reorder(lambda: self._intake.queue.defer(mission_id))

    def withdraw(self, mission_id: str) -> None:
        """Cancel a waiting mission; raises ValueError if it does not wait."""
        reason = "withdrawn by the operator"
        self._reorder(lambda: self._worker.drop(self._intake.queue.remove(mission_id), reason))

    def let_next_go_first(self) -> None:
        """Move the next mission ahead of the active one, which then waits again.

        Raises ValueError if no mission waits, or an asset is already moving for the active one.
        """
        self._require_writable()
        self._worker.let_next_go_first()

    def _queue(self, order: ReadText, *, active: bool, offered: bool = False) -> Mission:
        mission, received = self._intake.submit(order, active, offered=offered)
        self._emit(received, mission.id)
        self._worker.queue_changed()
        return mission

    def _corrected(self, order: ReadText) -> str:
        """Return how `order` corrects the operator's own waiting plan; '' if it does not."""
        active = self._worker.active
        if active is None or not self._worker.awaits_decision or not active.proposes:
            return ""
        return corrects(order.text) if active.mission.source == "operator" else ""

    def _change_in(self, order: ReadText) -> OrderChange | ManualWords | Unclear | None:
        """Return the change of standing orders or manual control in a text; None if it has none."""
        change = self._standing.read(order.text)
        if change is not None or order.question is not None:
            return change
        services = self._services()
        return read_manual(services.scene, order.text, services.gate.manual.taken)

    def _change(self, order: ReadText, change: OrderChange | ManualWords) -> Mission:
        """Carry out an operator's change at once and record it as a mission.

        Raises ValueError if the change is not possible.
        """
        if isinstance(change, OrderChange):
            reason = self._standing.carry_out(change)
        else:
            reason = self._manual.change(change)
        return self._done_at_once(order, reason)

    def _done_at_once(self, order: ReadText, reason: str) -> Mission:
        """Record an order that was carried out at once as a finished mission."""
        mission, received = self._intake.submit(order, active=False, waits=False)
        self._emit(received, mission.id)
        ended = ev.MissionFinished(status="verified", reason=reason, metrics=Metrics())
        self._emit(ended, mission.id)
        return mission

    def _reorder(self, change: Callable[[], None]) -> None:
        self._require_writable()
        change()
        self._worker.queue_changed()
