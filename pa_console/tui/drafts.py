"""Rules that were typed and not saved, kept in the user's state folder lest a crash loses them."""

import hashlib
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter

from pa_console.policy.rule_save import OpenRule
from pa_console.private_files import make_private_folder, replace_private

Draft = tuple[OpenRule, str]
_SHAPE = TypeAdapter(dict[str, Draft])


def drafts_folder() -> Path:
    """Return where drafts are kept for this user."""
    from platformdirs import user_state_path  # noqa: PLC0415 - only when rules can be edited

    return user_state_path("pa-console") / "drafts"


class Drafts(dict[str, Draft]):
    """Drafts of one rule file by rule id, '' for a new rule; a disk that refuses is no error."""

    def __init__(self, rules: Path | None = None, folder: Path | None = None) -> None:
        """Begin with what `folder` has of the rule file; without a file nothing is kept."""
        super().__init__()
        self._file: Path | None = None
        if rules is None:
            return
        place = hashlib.sha256(os.fsencode(rules.resolve())).hexdigest()[:16]
        self._file = (folder or drafts_folder()) / f"{rules.stem}-{place}.json"
        with suppress(OSError, ValueError):
            for name, (opened, text) in _SHAPE.validate_json(self._file.read_bytes()).items():
                self[name] = replace(opened, path=rules), text

    def note(self, opened: OpenRule, text: str) -> None:
        """Take `text` for the draft of a rule, or for none when it is what the file has."""
        if text == opened.text:
            self.pop(opened.id, None)
        else:
            self[opened.id] = opened, text

    def keep(self) -> None:
        """Write what there is, if that is possible; without a draft no file is left."""
        if self._file is None:
            return
        with suppress(OSError):
            if not self:
                self._file.unlink(missing_ok=True)
                return
            make_private_folder(self._file.parent)
            replace_private(self._file, _SHAPE.dump_json(dict(self)))
