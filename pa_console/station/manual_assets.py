"""The station's side of manual control: taking assets, giving them back, and what awaited them."""

from collections.abc import Callable, Collection, Iterable

from pa_console.language.orders.manual_words import ManualWords
from pa_console.mission.gate import CommandGate
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.station.intake import Intake
from pa_console.station.worker import EmitFor, StationParts


class ManualAssets:
    """Takes assets under manual control for an operator, and gives them back.

    Taking one is never asked about and needs no log: it only keeps commands back. A plan under way
    that needs the asset is halted by the picture, and planned anew for the others, which is asked
    about. Giving one back sends nothing: the missions that awaited it are queued again.
    """

    def __init__(
        self,
        parts: StationParts,
        require_writable: Callable[[], None],
        look: Callable[[], None],
        queue_changed: Callable[[], None],
    ) -> None:
        """`look` takes in the picture at once; `queue_changed` lets the next mission begin."""
        self._gate: CommandGate = parts.services.gate
        self._intake: Intake = parts.intake
        self._emit: EmitFor = parts.emit
        self._require_writable, self._look = require_writable, look
        self._queue_changed = queue_changed

    def take(self, asset: str, by: str = "operator") -> None:
        """Take manual control of `asset`; ValueError for an unknown one, or one that is taken."""
        self._require_writable()
        self._gate.take_manual(asset, by)
        self._emit(ev.ManualControlTaken(asset=asset, by=by), None)
        self._look()

    def end(self, asset: str, by: str = "operator") -> None:
        """Give `asset` back; raises ValueError where nobody has taken it, or nothing can be logged.

        What awaited it is queued anew; while everything is stopped, once the stop is released.
        """
        self._require_writable()
        self._gate.end_manual(asset)
        self._emit(ev.ManualControlEnded(asset=asset, by=by), None)
        self._look()

    def change(self, words: ManualWords, by: str = "operator") -> str:
        """Carry out an operator's words, and return the change; raises ValueError as they do.

        Of several assets none is changed unless all can be.
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
        """Go on with the assets of an earlier session, who took each, and what awaits them."""
        for asset, by in taken:
            self._gate.take_manual(asset, by)
        self._gate.manual.take_up(awaiting)

    def queue_returned(self) -> None:
        """Queue the missions whose assets are all back, unless everything is stopped."""
        if self._gate.stopped:
            return
        for back in self._gate.manual.come_back():
            again, received = self._intake.wait_again(back.mission)
            self._emit(received, again.id)
            ended = ev.MissionAwaitsAssets(assets=tuple(sorted(back.assets)), again=again.id)
            self._emit(ended, back.mission.id)
            self._queue_changed()
