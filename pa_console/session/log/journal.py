"""The journal: the log of a station's events; no command is dispatched before it is logged."""

import asyncio
from collections.abc import Callable

from pa_console.schema.events import event as ev
from pa_console.session.log.writer import LogWriter


class Journal:
    """The log of the station's events; `problem` is the reason why no command may be dispatched.

    All decisions and commands of one moment are signed together, once the event loop is free and at
    the latest before the next simulation step. A decision therefore takes effect only after it is
    signed, and a stop does not wait for the disk between its commands.
    """

    def __init__(self) -> None:
        """Begin without a log; until `open`, nothing is written and `problem` is ''."""
        self.problem = ""
        self._log: LogWriter | None = None
        self._tell: Callable[[ev.LogTroubled | ev.Noticed], None] = _nobody
        self._due: asyncio.Handle | None = None

    def open(self, log: LogWriter, tell: Callable[[ev.LogTroubled | ev.Noticed], None]) -> None:
        """Write to `log` from now on.

        `tell` is called with an event when `problem` changes, or when the log's witness stops or
        resumes receiving heads.
        """
        self._log, self._tell = log, tell

    @property
    def head(self) -> str:
        """The hash of the log's last record, which covers all earlier records; '' without a log."""
        return self._log.head if self._log is not None else ""

    def append(self, event: ev.Event) -> None:
        """Log one event; an urgent event is signed as soon as the event loop is free."""
        if self._log is None:
            return
        self._log.append(event, commit=False)
        if self._log.owes and self._due is None:
            self._due = asyncio.get_running_loop().call_soon(self.commit)
        self._look(self._log)

    def commit(self) -> str:
        """Sign decisions and commands and write them to disk now; return the `problem`."""
        if self._due is not None:
            self._due.cancel()
            self._due = None
        if self._log is not None:
            self._log.commit()
            self._look(self._log)
        return self.problem

    def _look(self, log: LogWriter) -> None:
        before, self.problem = self.problem, str(log.error) if log.error is not None else ""
        if self.problem != before:
            self._tell(ev.LogTroubled(problem=self.problem))
        if (news := log.news()) is not None:
            asyncio.get_running_loop().call_soon(self._tell, _witnessed(news))


def _witnessed(news: str) -> ev.Noticed:
    if news:
        text = f"does not get the log's signed heads: {news}"
        return ev.Noticed(level="warning", subject="witness", text=text)
    return ev.Noticed(level="info", subject="witness", text="gets the log's signed heads again")


def _nobody(_: ev.LogTroubled | ev.Noticed) -> None:
    pass
