"""Changes by an operator that take effect at once: manual control and standing orders."""

from collections.abc import Callable, Collection, Iterable

from pa_console.language.orders.order_changes import (
    Change,
    ManualWords,
    OrderChange,
    OrderUnderWay,
    read_change,
)
from pa_console.language.references.conversation import Unclear
from pa_console.mission.gate import CommandGate
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.station.intake import Intake
from pa_console.station.worker import EmitFor, MissionWorker, StationParts


class ManualAssets:
    """The assets under manual control.

    Taking manual control of an asset requires neither approval nor a log, because the only effect
    is that no commands are sent to the asset. The next picture halts a running plan that needs it.
    The mission is then planned again with the other assets, and the new plan requires approval.
    When the asset is given back, no command is sent, and the missions that awaited it are queued
    again.
    """

    def __init__(
        self,
        parts: StationParts,
        require_writable: Callable[[], None],
        look: Callable[[], None],
        queue_changed: Callable[[], None],
    ) -> None:
        """Call `look` to process the picture, and `queue_changed` after missions are queued."""
        self._gate: CommandGate = parts.services.gate
        self._intake: Intake = parts.intake
        self._emit: EmitFor = parts.emit
        self._require_writable, self._look = require_writable, look
        self._queue_changed = queue_changed

    def take(self, asset: str, by: str = "operator") -> None:
        """Take manual control of `asset`; raises ValueError if it is unknown or already taken."""
        self._require_writable()
        self._gate.take_manual(asset, by)
        self._emit(ev.ManualControlTaken(asset=asset, by=by), None)
        self._look()

    def end(self, asset: str, by: str = "operator") -> None:
        """End the manual control of `asset`.

        Missions that awaited the asset are queued again; during a stop, only after the release.
        Raises ValueError if the asset is not under manual control, or if the change cannot be
        logged.
        """
        self._require_writable()
        self._gate.end_manual(asset)
        self._emit(ev.ManualControlEnded(asset=asset, by=by), None)
        self._look()

    def change(self, words: ManualWords, by: str = "operator") -> str:
        """Carry out the change that an operator's words ask for, and return it in words.

        Either all named assets change or none of them. Raises ValueError as `take` and `end` do.
        """
        manual = self._gate.manual
        for asset in words.assets:
            if problem := manual.objection(asset, take=words.take):
                raise ValueError(problem)
        for asset in words.assets:
            (self.take if words.take else self.end)(asset, by)
        done = "under manual control" if words.take else "given back"
        return f"{done}: {', '.join(words.assets)}"

    def take_up(
        self, taken: Iterable[tuple[str, str]], awaiting: Iterable[tuple[Mission, Collection[str]]]
    ) -> None:
        """Restore manual control and the missions that await assets from an earlier session."""
        for asset, by in taken:
            self._gate.take_manual(asset, by)
        self._gate.manual.take_up(awaiting)

    def queue_returned(self) -> None:
        """Queue the missions whose assets have all been given back, unless the stop is in force."""
        if self._gate.stopped:
            return
        for back in self._gate.manual.come_back():
            again, received = self._intake.wait_again(back.mission)
            self._emit(received, again.id)
            ended = ev.MissionAwaitsAssets(assets=tuple(sorted(back.assets)), again=again.id)
            self._emit(ended, back.mission.id)
            self._queue_changed()


class StandingControl:
    """The control of standing orders: revoke, pause, resume, or skip the next scheduled time.

    If a standing order started the order in steps that is under way, both change together.
    """

    def __init__(
        self, parts: StationParts, worker: MissionWorker, require_writable: Callable[[], None]
    ) -> None:
        self._standing, self._fleet = parts.services.standing, parts.services.fleet
        self._queue, self._emit = parts.intake.queue, parts.emit
        self._worker, self._require_writable = worker, require_writable

    def read(self, text: str) -> OrderChange | Unclear | None:
        """Return the change of orders in force that a text asks for; None if it asks for none."""
        return read_change(text, (*self._standing.orders, *self._under_way()))

    def _under_way(self) -> tuple[OrderUnderWay, ...]:
        """Return the order in steps that is under way, unless a standing order started it."""
        run = self._worker.active
        if run is None or not run.in_steps or self._standing.find(run.mission.standing or ""):
            return ()
        mission = run.mission
        return (OrderUnderWay(mission.id, mission.said, "steps patrol", mission.text),)

    def carry_out(self, change: OrderChange) -> str:
        """Carry out an operator's change, and return it in words.

        Raises ValueError as `change` does.
        """
        run = self._worker.active
        for name in change.orders:
            if run is None or name != run.mission.id:
                self.change(name, change.change)
        affected = run is not None and {run.mission.id, run.mission.standing} & {*change.orders}
        if run is not None and run.in_steps and affected and change.change != "skip":
            self._worker.change_steps(change.change)
        return f"{change.done}: {', '.join(change.orders)}"

    def change(self, order_id: str, change: Change, by: str = "operator") -> None:
        """Revoke, pause or resume a standing order, or skip its next scheduled time.

        If an order is revoked, its waiting missions are removed from the queue; a mission that has
        begun continues. Raises ValueError if the order is not in force or nothing would change.
        """
        self._require_writable()
        match change:
            case "revoke":
                self._revoke(order_id, by)
                return
            case "skip":
                self._standing.skip(order_id)
                done = "skipped"
            case "pause" | "resume":
                self._standing.pause(order_id, paused=change == "pause")
                done = "paused" if change == "pause" else "resumed"
        self._emit(self._standing.scheduled(order_id, done, by, self._fleet.time_s), None)

    def _revoke(self, order_id: str, by: str) -> None:
        self._standing.revoke(order_id)
        self._emit(ev.StandingOrderRevoked(order_id=order_id, by=by), None)
        for mission in self._queue.take(lambda waiting: waiting.standing == order_id):
            self._worker.drop(mission, f"standing order {order_id} was revoked")
        self._worker.queue_changed()

    def mission_ended(self, mission: str, payload: ev.MissionFinished) -> None:
        """Record the end of a mission for the standing order that started it.

        If a timed mission was not carried out, a notice is emitted at alarm level, because there
        may have been no operator at the screen.
        """
        ended = self._standing.ended(
            mission,
            self._fleet.time_s,
            self._fleet.world.base,
            failed=payload.status in ("held", "failed", "unverified"),
        )
        if ended is None:
            return
        order, remark = ended
        if remark:
            self._emit(ev.StandingOrderWithheld(order_id=order.id, reason=remark), None)
        if order.schedule is not None and payload.status in ("held", "refused", "failed"):
            text = f"{order.id}, {order.words}: {mission} was {payload.status}: {payload.reason}"
            self._emit(ev.Noticed(level="alarm", subject=order.id, text=text[:500]), None)
