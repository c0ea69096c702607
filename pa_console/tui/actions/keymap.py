"""The user's own keys, and which command a refused key would have given."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Protocol

from textual.binding import Binding, InvalidBinding
from textual.keys import REPLACED_KEYS, Keys, key_to_character

from pa_console.language.references.resolution import MOST_CHOICES
from pa_console.schema.events.event import MOST_READINGS
from pa_console.tui.actions.registry import ACTIONS, ConsoleAction, action_of, key_text

READING_KEYS = tuple(f"alt+{number}" for number in range(1, max(MOST_READINGS, MOST_CHOICES) + 1))
"""The keys of the other readings of an order, or of answers, at the approval panel."""

ALT_DIGITS = (
    "inverted_exclamation_mark",
    "trade_mark_sign",
    "pound_sign",
    "cent_sign",
    "infinity",
    "section_sign",
)
"""Textual's keys for Alt+1 to Alt+6 on terminals that send Escape and the digit."""

_PANEL = {"a": "Approve", "r": "Reject", "m": "Modify"}
"""The keys of the approval panel, which a recording does not have."""


class KeysHost(Protocol):
    """The app with the user's own keys, by the names of the actions."""

    keys: Mapping[str, str]


def refused_command(key: str, keymap: Mapping[str, str]) -> str:
    """Return the name of the command that `key` gives in a live session; empty if it gives none."""
    for action in ACTIONS:
        keys = ",".join(own_keys(action, keymap).values()).split(",")
        if "live" in action.needs and key in keys:
            return action.label
    return _PANEL.get(key, "")


RESERVED = {
    **dict.fromkeys(("tab", "shift+tab", "enter", "up", "down"), "moving about needs it"),
    **dict.fromkeys(("r", "m", "a", "alt+c", *READING_KEYS), "the approval panel answers to it"),
    "ctrl+c": "the terminal's own interrupt",
}
_MODIFIERS = frozenset(("ctrl", "shift", "alt", "super", "hyper", "meta"))
_NAMED = frozenset((*(str(key.value) for key in Keys), *REPLACED_KEYS))


class KeymapError(ValueError):
    """Keys that cannot be used; `name` is the entry of the keymap that is at fault."""

    def __init__(self, name: str, problem: str) -> None:
        self.name, self.problem = name, problem
        super().__init__(f"keys.{name}: {problem}")


def own_keys(action: ConsoleAction, keymap: Mapping[str, str]) -> dict[str, str]:
    """Return the keys of an action by the names that a keymap knows them by."""
    return {
        item.id: keymap.get(item.id, item.key) for item in action.bindings if item.id is not None
    }


def shown_keys(action: ConsoleAction, keymap: Mapping[str, str]) -> str:
    """Return an action's keys, the user's in place of the console's own, as they are written."""
    return key_text(",".join(own_keys(action, keymap).values()))


def first_own_key(name: str, keymap: Mapping[str, str]) -> str:
    """Return the first key of the action `name`, the user's or the console's own, as written."""
    return key_text(next(iter(own_keys(action_of(name), keymap).values())).partition(",")[0])


def key_names() -> dict[str, ConsoleAction]:
    """Return every name that a keymap may use, with the action that it stands for."""
    return {name: action for action in ACTIONS for name in own_keys(action, {})}


def check_keys(keymap: Mapping[str, str]) -> None:
    """Raise KeymapError for an unknown name, a key that is none, or one that is taken."""
    names = key_names()
    for name, keys in keymap.items():
        if name not in names:
            near = get_close_matches(name, names, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise KeymapError(name, f"there is no such action{hint}")
        for key in _split(name, keys):
            _check_key(name, key)
    taken: dict[str, str] = {}
    for name in sorted(names, key=lambda known: known in keymap):
        for key in _split(name, own_keys(names[name], keymap)[name]):
            other = taken.setdefault(key, name)
            if other != name:
                what = names[other].help
                problem = (
                    f"{key_text(key)} is the key of {other} ({what}); give one of them another"
                )
                raise KeymapError(name, problem)


def _split(name: str, keys: str) -> list[str]:
    """Return the keys as Textual names them; raises KeymapError when there are none."""
    try:
        return [item.key for item in Binding.make_bindings([Binding(keys, "")])]
    except InvalidBinding as error:
        problem = "expected key names separated by commas, like f11,ctrl+x"
        raise KeymapError(name, problem) from error


def _check_key(name: str, key: str) -> None:
    *modifiers, plain = key.split("+")
    known = plain in _NAMED or key_to_character(plain) is not None
    if not known or not _MODIFIERS.issuperset(modifiers):
        raise KeymapError(name, f"“{key}” is not a key; write it like f11, ctrl+x, X or plus")
    if key in RESERVED:
        raise KeymapError(name, f"{key_text(key)} cannot be used: {RESERVED[key]}")
