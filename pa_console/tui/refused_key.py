"""Which command a key would have given, had the session been live: so that none fails silently."""

from collections.abc import Mapping
from typing import Protocol

from pa_console.tui.actions import ACTIONS
from pa_console.tui.keymap import own_keys

_PANEL = {"a": "Approve", "r": "Reject", "m": "Modify"}
"""The keys of the approval panel, which a recording does not have."""


class KeysHost(Protocol):
    """What is needed of the app: the user's own keys, by the names of the actions."""

    keys: Mapping[str, str]


def refused_command(key: str, keymap: Mapping[str, str]) -> str:
    """Return the name of the command that `key` gives in a live session; empty if it gives none."""
    for action in ACTIONS:
        keys = ",".join(own_keys(action, keymap).values()).split(",")
        if "live" in action.needs and key in keys:
            return action.label
    return _PANEL.get(key, "")
