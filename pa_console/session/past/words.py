"""How a recorded session is told in a row: its outcomes, and when it began."""

from pa_console.session.past.summary import SessionSummary
from pa_console.session.status_words import status_of


def outcome_words(summary: SessionSummary) -> str:
    """Say how the missions ended, e.g. `2 verified, 1 rejected`; `none` without a mission."""
    words = (
        f"{number} {status_of('mission', status).word}"
        for status, number in summary.outcomes.items()
    )
    return ", ".join(words) or "none"


def when(summary: SessionSummary) -> str:
    """Return when the session began, in the time of this machine; empty when that is unknown."""
    return f"{summary.started.astimezone():%Y-%m-%d %H:%M:%S}" if summary.started else ""
