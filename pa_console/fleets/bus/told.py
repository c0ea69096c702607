"""Bus notices for the operator, one line each; repeated notices are counted."""

from pa_console.schema.events.event import IncidentHappened, Level, Noticed

REPEAT_S = 10.0
MOST_SUBJECTS = 1000


class Told:
    """Collects lines for the session log; the same of one subject is told once in REPEAT_S."""

    def __init__(self) -> None:
        self._lines: list[IncidentHappened | Noticed] = []
        self._last: dict[tuple[str, str], float] = {}
        self._more: dict[tuple[str, str], int] = {}

    def add(self, event: IncidentHappened | Noticed) -> None:
        """Add `event` as it is."""
        self._lines.append(event)

    def say(self, level: Level, subject: str, text: str, now_s: float, kind: str = "") -> None:
        """Add a notice at `now_s`, unless one of the same `kind` was added just now."""
        key = (subject, kind or text)
        if key not in self._last and len(self._last) >= MOST_SUBJECTS:
            key = ("", kind)
        last_s = self._last.get(key)
        if last_s is not None and now_s - last_s < REPEAT_S:
            self._more[key] = self._more.get(key, 0) + 1
            return
        more = self._more.pop(key, 0)
        self._last[key] = now_s
        since = f" (and {more} more like it)" if more else ""
        shown = "".join(c if c.isprintable() else " " for c in text[:500])
        self._lines.append(Noticed(level=level, subject=subject[:64], text=f"{shown}{since}"))

    def take(self) -> tuple[IncidentHappened | Noticed, ...]:
        """Return the notices since the last call."""
        lines, self._lines = self._lines, []
        return tuple(lines)
