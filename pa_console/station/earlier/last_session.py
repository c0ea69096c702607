"""The last session of a world: a summary, and the standing orders in force at its end."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from threading import Thread

from pa_console.schema.events import event as ev
from pa_console.schema.text import count
from pa_console.session.log.chain import LogError
from pa_console.session.past_sessions import fold_decisions, is_held, newest_logs
from pa_console.session.state import SessionState
from pa_console.station.earlier.unclosed_session import LOOKED_AT

ENDED = "the session has ended"
"""The reason that is recorded when a standing order ends because its session ended."""


class LastSession:
    """The last session of a world among the logs in a folder that are not in use.

    The first call of `news` starts the search, which is in a thread because a log may be long. A
    later call returns the summary.
    """

    def __init__(self, folder: Path, world_sha256: str, key: str, offered: str = "") -> None:
        """Prepare the search; `key` is the key with which the operator submits the orders again.

        `offered`, the world's own standing order, is left out because it is offered anyway.
        """
        self._folder, self._world, self._key, self._offered = folder, world_sha256, key, offered
        self._reports: list[ev.OutsideReport] = []
        self.orders: tuple[str, ...] = ()
        """The texts of the standing orders that were in force and are not yet submitted again."""
        self._looking = Thread(target=self._look, name="last-session", daemon=True)

    def news(self) -> Sequence[ev.OutsideReport]:
        """Return the summary when it is ready; later calls return nothing."""
        if self._looking.ident is None:
            self._looking.start()
        reports, self._reports = self._reports, []
        return reports

    def wait(self) -> None:
        """Wait until the search has ended."""
        self._looking.join()

    def take_up(self) -> tuple[str, ...]:
        """Return the texts of the orders to submit again, and forget them."""
        orders, self.orders = self.orders, ()
        return orders

    def _look(self) -> None:
        for log in newest_logs(self._folder)[:LOOKED_AT]:
            try:
                if is_held(log):
                    continue
                state, last = fold_decisions(log, self._world)
            except (LogError, OSError, ValueError):
                continue
            if state is not None and last is not None and state.started is not None:
                self._tell(state, state.started.session, last)
                return

    def _tell(self, state: SessionState, session: str, last: datetime) -> None:
        orders = dict.fromkeys(
            trace.order.text for trace in state.standing.values() if trace.ended in ("", ENDED)
        )
        orders.pop(self._offered, None)
        missions = sum(trace.status is None for trace in state.missions.values())
        left = [count(missions, "mission")] if missions else []
        left += [count(len(state.open_alarms), "alarm")] if state.open_alarms else []
        text = f"{session} ended {last.astimezone():%Y-%m-%d %H:%M}"
        text += "" if state.ended else ", not closed"
        text += f"; left open: {' and '.join(left)}" if left else "; nothing was left open"
        if orders:
            named = "; ".join(f"“{order}”" for order in orders)
            text += f"; {self._key} submits again the orders that were in force: {named}"
        self.orders = tuple(orders)
        self._reports = [ev.Noticed(level="info", subject="last session", text=text)]
