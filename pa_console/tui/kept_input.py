"""The files in the user's state folder: typed missions, unsaved rules, copied texts."""

import hashlib
import os
import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from platformdirs import user_state_path
from pydantic import TypeAdapter

from pa_console.policy.authoring.rule_save import OpenRule
from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.text import visible

KeptDraft = tuple[OpenRule, str]
_SHAPE = TypeAdapter(dict[str, KeptDraft])

HISTORY_KEPT = 200
_WRITTEN = re.compile(r"\\([\\n])")


class Drafts(dict[str, KeptDraft]):
    """The drafts of one rule file, by rule id ('' for a new rule); disk errors are ignored."""

    def __init__(self, rules: Path | None = None, folder: Path | None = None) -> None:
        """Load the drafts of the file `rules` from `folder`; without a file, nothing is stored."""
        super().__init__()
        self._file: Path | None = None
        if rules is None:
            return
        place = hashlib.sha256(os.fsencode(rules.resolve())).hexdigest()[:16]
        folder = folder or user_state_path("pa-console") / "drafts"
        self._file = folder / f"{rules.stem}-{place}.json"
        with suppress(OSError, ValueError):
            for name, (opened, text) in _SHAPE.validate_json(self._file.read_bytes()).items():
                self[name] = replace(opened, path=rules), text

    def note(self, opened: OpenRule, text: str) -> None:
        """Store `text` as the draft of a rule, or drop the draft if `text` is unchanged."""
        if text == opened.text:
            self.pop(opened.id, None)
        else:
            self[opened.id] = opened, text

    def keep(self) -> None:
        """Write the drafts to disk if possible; delete the file if there are no drafts."""
        if self._file is None:
            return
        with suppress(OSError):
            if not self:
                self._file.unlink(missing_ok=True)
                return
            make_private_folder(self._file.parent)
            replace_private(self._file, _SHAPE.dump_json(dict(self)))


def history_file() -> Path:
    """Return the path of this user's history file."""
    return user_state_path("pa-console") / "missions.txt"


class History:
    """The typed texts, oldest first, with a cursor that the up and down keys move.

    If `file` is None, nothing is stored. The file has one text per line. A backslash is written as
    two backslashes, and a line feed as a backslash and an `n`.
    """

    def __init__(self, file: Path | None = None, kept: int = HISTORY_KEPT) -> None:
        self._file, self._kept = file, kept
        self._texts: list[str] = []
        if file is not None:
            with suppress(OSError, UnicodeDecodeError):
                lines = file.read_text(encoding="utf-8").splitlines()
                self._texts = self._newest([_read(line) for line in lines if line.strip()])
        self._at = len(self._texts)
        self._draft = ""

    def add(self, text: str) -> None:
        """Add `text` as the newest entry, remove any earlier copy, and write the file if possible.

        Line breaks are kept; blank lines and extra spaces are removed.
        """
        text = "\n".join(line for part in text.splitlines() if (line := " ".join(part.split())))
        self._texts = self._newest([*(earlier for earlier in self._texts if earlier != text), text])
        self._at, self._draft = len(self._texts), ""
        if self._file is not None:
            with suppress(OSError):
                make_private_folder(self._file.parent)
                replace_private(self._file, "".join(map(_written, self._texts)).encode())

    @property
    def texts(self) -> tuple[str, ...]:
        """All texts, newest first."""
        return tuple(reversed(self._texts))

    def _newest(self, texts: list[str]) -> list[str]:
        return texts[-self._kept :] if self._kept else []

    def move(self, by: int, current: str) -> str:
        """Return the text `by` entries away; past the newest entry, return the text being typed."""
        if self._at == len(self._texts):
            self._draft = current
        self._at = max(0, min(len(self._texts), self._at + by))
        return self._texts[self._at] if self._at < len(self._texts) else self._draft


def _written(text: str) -> str:
    return text.replace("\\", r"\\").replace("\n", r"\n") + "\n"


def _read(line: str) -> str:
    return _WRITTEN.sub(lambda escape: "\n" if escape[1] == "n" else escape[1], line)


def export_folder() -> Path:
    """Return the folder for this user's copies."""
    return user_state_path("pa-console") / "copies"


def write_copy(folder: Path, name: str, text: str) -> str:
    """Write `text` to the file `name` in `folder`; return a message with its path or the error."""
    path = folder / name
    try:
        make_private_folder(folder)
        replace_private(path, visible(text).encode())
    except OSError as error:
        return f"not written to a file: {error.strerror or error}"
    return f"written to {path}"
