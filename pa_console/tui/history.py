"""The missions typed before, kept in the user's state folder; a disk that refuses is no error."""

from contextlib import suppress
from pathlib import Path

from pa_console.private_files import make_private_folder, replace_private

HISTORY_KEPT = 200


def history_file() -> Path:
    """Return where the history is kept for this user."""
    from platformdirs import user_state_path  # noqa: PLC0415  (only when the prompt is first used)

    return user_state_path("pa-console") / "missions.txt"


class History:
    """Typed texts, oldest first, with a cursor that up and down move; `file` None keeps nothing."""

    def __init__(self, file: Path | None = None, kept: int = HISTORY_KEPT) -> None:
        self._file, self._kept = file, kept
        self._texts: list[str] = []
        if file is not None:
            with suppress(OSError, UnicodeDecodeError):
                lines = file.read_text(encoding="utf-8").splitlines()
                self._texts = self._newest([line for line in lines if line.strip()])
        self._at = len(self._texts)
        self._draft = ""

    def add(self, text: str) -> None:
        """Remember `text` as the newest, once, and write the file if that is possible."""
        text = " ".join(text.split())
        self._texts = self._newest([*(known for known in self._texts if known != text), text])
        self._at, self._draft = len(self._texts), ""
        if self._file is not None:
            with suppress(OSError):
                make_private_folder(self._file.parent)
                replace_private(self._file, "\n".join([*self._texts, ""]).encode())

    def _newest(self, texts: list[str]) -> list[str]:
        return texts[-self._kept :] if self._kept else []

    def move(self, by: int, current: str) -> str:
        """Return the text `by` entries away; what was being typed comes back at the end."""
        if self._at == len(self._texts):
            self._draft = current
        self._at = max(0, min(len(self._texts), self._at + by))
        return self._texts[self._at] if self._at < len(self._texts) else self._draft
