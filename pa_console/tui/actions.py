"""The registry of the console's actions, with their default keys and the user's own keys.

The bindings, the footer, the command palette and the help are generated from this registry.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal, Protocol, get_args

from textual.binding import Binding, BindingType, InvalidBinding
from textual.keys import REPLACED_KEYS, Keys, key_to_character

from pa_console.language.references.resolution import MOST_CHOICES
from pa_console.schema.events.event import MOST_READINGS

Need = Literal[
    "live", "replay", "writable", "types", "decides", "stops", "agents", "commander", "mission",
    "idle_trace", "approval", "alarm", "unseen", "queue", "undecided", "stopped", "left",
]  # fmt: skip
Group = Literal[
    "Mission", "Safety", "Alarms", "Queue", "View", "Map", "Copy", "Simulation", "Replay", "Console"
]  # fmt: skip

_COMMAND: tuple[Need, ...] = ("live", "writable")
GROUPS: tuple[Group, ...] = get_args(Group)
READING_KEYS = tuple(f"alt+{number}" for number in range(1, max(MOST_READINGS, MOST_CHOICES) + 1))
"""The keys at the approval panel that choose another reading of an order, or an answer to a
question about it."""

ALT_DIGITS = (
    "inverted_exclamation_mark",
    "trade_mark_sign",
    "pound_sign",
    "cent_sign",
    "infinity",
    "section_sign",
)
"""Textual's names for Alt+1 to Alt+6 on terminals that send Escape and then the digit."""

_PANEL = {"a": "Approve", "r": "Reject", "m": "Modify"}
"""The keys of the approval panel, which recordings do not have."""

RESERVED = {
    **dict.fromkeys(("tab", "shift+tab", "enter", "up", "down"), "it is needed to move around"),
    **dict.fromkeys(("r", "m", "a", "alt+c", *READING_KEYS), "it is a key of the approval panel"),
    "ctrl+c": "the terminal uses it to interrupt",
}
_MODIFIERS = frozenset(("ctrl", "shift", "alt", "super", "hyper", "meta"))
_NAMED = frozenset((*(str(key.value) for key in Keys), *REPLACED_KEYS))


@dataclass(frozen=True)
class ActionContext:
    """The state that decides which actions are legal at this moment."""

    replay: bool = False
    readonly: bool = False
    decides: bool = True
    stops: bool = True
    commander: bool = False
    asks: bool = False
    """True if questions are accepted; a joined console accepts them without missions."""
    mission: bool = False
    traced: bool = False
    approval: bool = False
    alarms: int = 0
    unseen: int = 0
    queue: int = 0
    agents: bool = False
    """True if an agent has proposed something."""
    stopped: bool = False
    left: bool = False
    """True if standing orders of the last session can be taken up again."""


class ActionHost(Protocol):
    """The part of the app that screens use for actions."""

    @property
    def situation(self) -> ActionContext:
        """The state that decides which actions are legal now."""
        ...

    @property
    def keys(self) -> Mapping[str, str]:
        """The user's own keys, by the names of the actions."""
        ...


@dataclass(frozen=True)
class ConsoleAction:
    """An action of the operator.

    In the user's keymap, `id` names the first key and `id.also` the others. `keys` are Textual key
    names separated by commas. The tables in `pa_console.tui.controllers.controllers` have the
    functions that carry out the actions.
    """

    id: str
    keys: str
    label: str
    help: str
    group: Group
    needs: tuple[Need, ...] = ()
    footer: bool = False
    palette: bool = True
    urgent: bool = False
    opens_field: bool = False
    """True if the action opens a field for the keys that follow.

    The action then runs at once, so that no letter typed quickly after it is taken for another
    command.
    """
    confirmed: bool = False
    """True if a printable key only selects the action and Enter confirms it.

    A printable key may be the first letter of a text. A function key or a key with Ctrl runs the
    action at once.
    """

    words: str = ""
    """Further words with which the palette finds the action."""
    app_action: str = ""
    """The built-in Textual action to run; '' if a controller carries out the action."""

    @property
    def action(self) -> str:
        """The action string for Textual's bindings; one app method carries out all actions."""
        return self.app_action or f"carry_out({self.id!r})"

    def refusal(self, now: ActionContext) -> str:
        """Return the reason why the action is not legal now; empty if it is legal."""
        return next((why for need in self.needs if (why := _refusal(need, now))), "")

    @property
    def bindings(self) -> list[Binding]:
        """The Textual bindings; an urgent action's first key works on every screen."""
        first, _, others = self.keys.partition(",")
        result = [
            Binding(
                first, self.action, self.label, show=self.footer, id=self.id, tooltip=self.help,
                priority=self.urgent or self.opens_field,
            )
        ]  # fmt: skip
        if others:
            also = Binding(
                others, self.action, self.label, show=False, id=f"{self.id}.also",
                priority=self.opens_field,
            )  # fmt: skip
            result.append(also)
        return result


def _refusal(need: Need, now: ActionContext) -> str:
    legal, why = {
        "live": (not now.replay, "not in a replay"),
        "replay": (now.replay, "only in a replay"),
        "writable": (not now.readonly, "the console is read-only"),
        "types": (not now.readonly or now.asks, "the console is read-only"),
        "decides": (now.decides, "nothing is decided here"),
        "stops": (now.stops, "the console is read-only"),
        "commander": (now.commander, "only for a commander at a console that has joined"),
        "mission": (now.mission, "no mission is active"),
        "idle_trace": (now.traced, "there is no mission yet"),
        "approval": (now.approval, "nothing waits for approval"),
        "alarm": (now.alarms > 0, "no alarm is open"),
        "unseen": (now.unseen > 0, "every alarm has been seen"),
        "queue": (now.queue > 0, "no mission waits"),
        "undecided": (now.approval, "no mission waits for your answer"),
        "agents": (now.agents, "no agent has proposed anything"),
        "stopped": (now.stopped, "nothing is stopped"),
        "left": (now.left, "the last session left no standing order"),
    }[need]
    return "" if legal else why


ACTIONS: tuple[ConsoleAction, ...] = (
    ConsoleAction(
        "help", "f1,question_mark", "Help", "Show all keys and the meaning of every sign",
        "Console", footer=True,
    ),
    ConsoleAction("manual", "M", "Manual", "Read and search the manual", "Console"),
    ConsoleAction("view_map", "f2,1", "Map", "Go to the map", "View"),
    ConsoleAction("view_assets", "f3,2", "Assets", "Go to the assets", "View"),
    ConsoleAction("view_trace", "f4,3", "Trace", "Go to the trace of the mission", "View"),
    ConsoleAction("view_events", "f5,4", "Events", "Go to the event list", "View"),
    ConsoleAction("view_alarms", "5", "Alarms", "Go to the alarms and the waiting missions",
                  "View"),
    ConsoleAction("policies", "f6,p", "Policies", "Browse and search the rules", "View",
                  footer=True),
    ConsoleAction("evaluation", "e", "Evaluation",
                  "Look at an evaluation: runs, failures, tables, traces", "View"),
    ConsoleAction("sessions", "L", "Sessions",
                  "Look at the recorded sessions: open, compare, export, run again", "View",
                  words="export save replay recording history log"),
    ConsoleAction("standing_orders", "V", "Standing orders",
                  "Look at the standing orders and their missions; pause or revoke one", "Mission",
                  words="whenever revoke automatic repeat"),
    ConsoleAction("take_up", "ctrl+n,U", "Take up again",
                  "Submit the last session's standing orders again; each waits for your approval",
                  "Mission", needs=(*_COMMAND, "left"),
                  confirmed=True, words="last shift resume"),
    ConsoleAction(
        "approval", "f7,g", "To approval", "Go to the plan that waits for a decision",
        "Mission", needs=("live", "decides", "approval"), footer=True,
    ),
    ConsoleAction(
        "cancel", "f8,c", "Cancel", "Cancel the active mission, in any stage",
        "Mission", needs=(*_COMMAND, "mission"), footer=True,
        confirmed=True,
    ),
    ConsoleAction(
        "stop", "f9,S", "STOP ALL",
        "Stop: every asset holds, open plans are void, nothing else is sent until it is released",
        "Safety", needs=("live", "stops"), footer=True, urgent=True,
        confirmed=True,
    ),
    ConsoleAction(
        "release", "ctrl+l", "Release stop", "Release the stop, after confirmation; missions "
        "are then accepted again", "Safety", needs=(*_COMMAND, "stopped"), footer=True,
    ),
    ConsoleAction(
        "take_command", "ctrl+k", "Take command", "Take command from the joined station, after "
        "confirmation; this console then opens again in command", "Safety",
        needs=("live", "commander"), words="takeover epoch station",
    ),
    ConsoleAction(
        "acknowledge", "k,f12", "Seen",
        "Acknowledge the alarm at the pointer, or the worst new one",
        "Alarms", needs=(*_COMMAND, "unseen"), footer=True,
        confirmed=True,
    ),
    ConsoleAction("next_alarm", "j", "Next alarm", "Put the pointer on the next alarm", "Alarms",
                  needs=("alarm",)),
    ConsoleAction("next_queued", "o", "Next waiting", "Put the pointer on the next waiting mission",
                  "Queue", needs=("queue",)),
    ConsoleAction("sooner", "u", "Sooner", "Move the waiting mission at the pointer up", "Queue",
                  needs=(*_COMMAND, "queue"),
                  confirmed=True),
    ConsoleAction("later_queued", "d", "Later", "Move the waiting mission at the pointer down",
                  "Queue", needs=(*_COMMAND, "queue"),
                  confirmed=True),
    ConsoleAction("go_first", "alt+b,b", "Let first",
                  "Let the next mission go before the one that waits for your answer, which is "
                  "then queued and planned again", "Queue",
                  needs=(*_COMMAND, "queue", "undecided"), confirmed=True,
                  words="queue question stuck behind"),
    ConsoleAction("defer", "z", "Defer", "Let every other mission go before the one at the pointer",
                  "Queue", needs=(*_COMMAND, "queue"),
                  confirmed=True),
    ConsoleAction("withdraw", "x", "Withdraw", "Take the mission at the pointer out of the queue",
                  "Queue", needs=(*_COMMAND, "queue"),
                  confirmed=True),
    ConsoleAction("mute_agent", "A,ctrl+g", "Mute agent",
                  "Mute the agent that proposed last and cancel its proposals, or let it propose "
                  "again", "Queue", needs=(*_COMMAND, "agents"),
                  confirmed=True, words="mcp agent silence"),
    ConsoleAction("follow", "t", "Follow", "Keep the subject of the alarm at the pointer in view",
                  "Map"),
    ConsoleAction("zoom_in", "full_stop,greater_than_sign", "Zoom in", "Zoom the map in", "Map"),
    ConsoleAction("zoom_out", "comma,less_than_sign", "Zoom out", "Zoom the map out", "Map"),
    ConsoleAction("sensors", "v", "Sensors",
                  "Show the cameras' fields of view, then the assets' too, then none",
                  "Map"),
    ConsoleAction("pan_left", "shift+left", "West", "Look further west", "Map", palette=False),
    ConsoleAction("pan_right", "shift+right", "East", "Look further east", "Map", palette=False),
    ConsoleAction("pan_up", "shift+up", "North", "Look further north", "Map", palette=False),
    ConsoleAction("pan_down", "shift+down", "South", "Look further south", "Map", palette=False),
    ConsoleAction("filter", "f", "Filter", "Filter assets, tracks and cameras by any words",
                  "View", opens_field=True),
    ConsoleAction("problems", "F", "Problems",
                  "Show only rows that need attention, or all rows again", "View"),
    ConsoleAction("prompt", "i,slash", "Mission", "Type a mission", "Mission",
                  needs=("live", "types"), opens_field=True),
    ConsoleAction("history", "ctrl+r", "Earlier orders",
                  "Search the orders of this and earlier sessions, to type one again",
                  "Mission", needs=_COMMAND,
                  words="history past missions"),
    ConsoleAction("favourites", "ctrl+t", "Favourites",
                  "Choose a favourite order or a template, to type it", "Mission", needs=_COMMAND,
                  words="template slot"),
    ConsoleAction("keep_favourite", "ctrl+s", "Keep order",
                  "Keep the order in the mission field, or else the last one, as a favourite",
                  "Mission", needs=_COMMAND,
                  words="save favourite template"),
    ConsoleAction("thing", "ctrl+o", "Asset, place",
                  "Choose an asset, a track or a place, and then an order for it", "Mission",
                  words="card menu gate click send"),
    ConsoleAction("leave", "escape", "Leave", "Leave the field; the typed text stays",
                  "Mission", palette=False),
    ConsoleAction("earlier", "left_square_bracket", "Earlier",
                  "Show the trace of the previous mission", "View", needs=("idle_trace",)),
    ConsoleAction("later", "right_square_bracket", "Later", "Show the trace of the next mission",
                  "View", needs=("idle_trace",)),
    ConsoleAction("copy_trace", "y", "Copy trace", "Copy the trace, and write it to a file",
                  "Copy", needs=("idle_trace",),
                  words="export save session report"),
    ConsoleAction("copy_plan", "Y", "Copy plan", "Copy the plan's JSON, and write it to a file",
                  "Copy", needs=("idle_trace",),
                  words="export save"),
    ConsoleAction("screenshot", "P", "Screenshot", "Write a screenshot to an SVG file", "Copy",
                  words="picture save svg"),
    ConsoleAction("faster", "plus", "Faster", "Twice the speed, up to 8x (replay: 32x)",
                  "Simulation"),
    ConsoleAction("slower", "minus", "Slower", "Half the speed, down to 1x (replay: 1/4x)",
                  "Simulation"),
    ConsoleAction("play", "space", "Play/pause", "Play or pause the replay", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("step", "right", "Step", "One event forward", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("back", "left", "Back", "One event back", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("second", "l,ctrl+right", "+1 s", "One simulated second forward", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("second_back", "h,ctrl+left", "-1 s", "One simulated second back", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("next_mission", "n", "Next mission", "Jump to the next mission", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("mission_before", "N", "Previous mission",
                  "Jump to the previous mission", "Replay", needs=("replay",)),
    ConsoleAction("next_finding", "w", "Next finding",
                  "Jump to the next finding, override, alarm, refusal or fault", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("finding_before", "W", "Previous finding",
                  "Jump to the previous finding, override, alarm, refusal or fault", "Replay",
                  needs=("replay",)),
    ConsoleAction("to_moment", "G", "To a time", "Jump to a time or an event number that you type",
                  "Replay", needs=("replay",), footer=True),
    ConsoleAction("search_log", "s", "Search", "Search the texts of the recording", "Replay",
                  needs=("replay",), footer=True),
    ConsoleAction("compare", "C", "Compare", "Find where another recording differs from this one",
                  "Replay", needs=("replay",), words="session"),
    ConsoleAction("theme", "T", "Theme", "Choose the colours", "Console",
                  app_action="change_theme"),
    ConsoleAction("settings", "O", "Settings", "See and change the settings, with help for each",
                  "Console"),
    ConsoleAction("palette", "f10,ctrl+p", "Palette", "Search all commands that are legal now",
                  "Console", app_action="command_palette", footer=True, palette=False),
    ConsoleAction("quit", "q,ctrl+q", "Quit", "Leave the console", "Console", footer=True,
                  confirmed=True, words="exit end session"),
)  # fmt: skip


_BY_ID = {action.id: action for action in ACTIONS}
_BY_CALL = {action.action: action for action in ACTIONS}


def action_of(name: str) -> ConsoleAction:
    """Return the action whose id is `name`."""
    return _BY_ID[name]


def find_action(name: str, parameters: tuple[object, ...]) -> ConsoleAction | None:
    """Return the registered action that Textual calls `name` with `parameters`."""
    return with_call(f"{name}({', '.join(map(repr, parameters))})" if parameters else name)


def with_call(call: str) -> ConsoleAction | None:
    """Return the registered action whose bindings have the action string `call`."""
    return _BY_CALL.get(call)


def bindings() -> list[BindingType]:
    """Return the bindings of the whole registry."""
    return [binding for action in ACTIONS for binding in action.bindings]


def first_key(name: str) -> str:
    """Return the first default key of the action `name`, as shown on the screen."""
    return key_text(action_of(name).keys.partition(",")[0])


def key_text(keys: str) -> str:
    """Return the keys named in `keys` as they are printed on a keyboard."""
    words = {
        "question_mark": "?",
        "slash": "/",
        "plus": "+",
        "minus": "-",
        "escape": "Esc",
        "enter": "Enter",
        "delete": "Del",
        "left_square_bracket": "[",
        "right_square_bracket": "]",
        "left": "←",
        "right": "→",
        "up": "↑",
        "down": "↓",
        "space": "Space",
        "full_stop": ".",
        "comma": ",",
        "greater_than_sign": ">",
        "less_than_sign": "<",
    }
    parts: list[str] = []
    for key in keys.split(","):
        *modifiers, plain = key.split("+")
        shown = words.get(plain, plain.upper() if plain[0] == "f" and len(plain) > 1 else plain)
        signs = {"ctrl": "^", "shift": "⇧"}
        parts.append("".join(signs.get(name, f"{name}+") for name in modifiers) + shown)
    return " ".join(parts)


def refused_command(key: str, keymap: Mapping[str, str]) -> str:
    """Return the label of the command that `key` gives in a live session; '' if none."""
    for action in ACTIONS:
        keys = ",".join(own_keys(action, keymap).values()).split(",")
        if "live" in action.needs and key in keys:
            return action.label
    return _PANEL.get(key, "")


class KeymapError(ValueError):
    """An error in the user's keys; `name` is the faulty entry of the keymap."""

    def __init__(self, name: str, problem: str) -> None:
        self.name, self.problem = name, problem
        super().__init__(f"keys.{name}: {problem}")


def own_keys(action: ConsoleAction, keymap: Mapping[str, str]) -> dict[str, str]:
    """Return the keys of an action, the user's or else the defaults, by their names in a keymap."""
    return {
        item.id: keymap.get(item.id, item.key) for item in action.bindings if item.id is not None
    }


def shown_keys(action: ConsoleAction, keymap: Mapping[str, str]) -> str:
    """Return an action's keys as shown on the screen; the user's keys replace the defaults."""
    return key_text(",".join(own_keys(action, keymap).values()))


def first_own_key(name: str, keymap: Mapping[str, str]) -> str:
    """Return the first key of the action `name`, the user's or the default, as it is shown."""
    return key_text(next(iter(own_keys(action_of(name), keymap).values())).partition(",")[0])


def key_names() -> dict[str, ConsoleAction]:
    """Return every valid name in a keymap, with its action."""
    return {name: action for action in ACTIONS for name in own_keys(action, {})}


def check_keys(keymap: Mapping[str, str]) -> None:
    """Raise KeymapError for an unknown name, an invalid key, or a key already in use."""
    names = key_names()
    for name, keys in keymap.items():
        if name not in names:
            near = get_close_matches(name, names, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise KeymapError(name, f"there is no such action{hint}")
        for key in _split(name, keys):
            _check_key(name, key)
    taken: dict[str, str] = {}
    for name in sorted(names, key=lambda item: item in keymap):
        for key in _split(name, own_keys(names[name], keymap)[name]):
            other = taken.setdefault(key, name)
            if other != name:
                effect = names[other].help
                problem = (
                    f"{key_text(key)} is the key of {other} ({effect}); give one of them another "
                    "key"
                )
                raise KeymapError(name, problem)


def _split(name: str, keys: str) -> list[str]:
    """Return Textual's names for `keys`; raise KeymapError if they are not a list of key names."""
    try:
        return [item.key for item in Binding.make_bindings([Binding(keys, "")])]
    except InvalidBinding as error:
        problem = "expected key names separated by commas, like f11,ctrl+x"
        raise KeymapError(name, problem) from error


def _check_key(name: str, key: str) -> None:
    *modifiers, plain = key.split("+")
    is_key = plain in _NAMED or key_to_character(plain) is not None
    if not is_key or not _MODIFIERS.issuperset(modifiers):
        raise KeymapError(name, f"“{key}” is not a key; write it like f11, ctrl+x, X or plus")
    if key in RESERVED:
        raise KeymapError(name, f"{key_text(key)} cannot be used: {RESERVED[key]}")
