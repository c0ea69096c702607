"""The controllers of a console, the actions that each carries out, and the command palette."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol, cast

from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.types import IgnoreReturnCallbackType

from pa_console.session.recording import Player
from pa_console.tui.actions import ACTIONS, shown_keys
from pa_console.tui.controllers.approval import ApprovalController
from pa_console.tui.controllers.browsing import BrowsingController
from pa_console.tui.controllers.commands import RATES, CommandController, WhatIf, what_ifs
from pa_console.tui.controllers.composing import ComposingController
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.leaving import LeavingController
from pa_console.tui.controllers.rules import RulesController
from pa_console.tui.controllers.settings import SettingsController
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.screens.recording import FINDING, RecordingScreen
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionPrompt

TYPICAL = ("unknown vehicle", "weather")
"""Words in the titles of the what-ifs that are offered before anything is typed."""

ON_SCREEN: Mapping[str, Callable[[MainScreen], object]] = {
    "view_map": lambda shown: shown.focus_view("map"),
    "view_assets": lambda shown: shown.focus_view("assets"),
    "view_trace": lambda shown: shown.focus_view("trace"),
    "view_events": lambda shown: shown.focus_view("events"),
    "view_alarms": lambda shown: shown.focus_view("alarms"),
    "next_alarm": lambda shown: shown.show_alarms().next_alarm(),
    "next_queued": lambda shown: shown.show_alarms().next_mission(),
    "zoom_in": lambda shown: shown.query_one(MapView).zoom_by(2.0),
    "zoom_out": lambda shown: shown.query_one(MapView).zoom_by(0.5),
    "sensors": lambda shown: shown.query_one(MapView).next_sensors(),
    "pan_left": lambda shown: shown.query_one(MapView).pan(-1, 0),
    "pan_right": lambda shown: shown.query_one(MapView).pan(1, 0),
    "pan_up": lambda shown: shown.query_one(MapView).pan(0, 1),
    "pan_down": lambda shown: shown.query_one(MapView).pan(0, -1),
    "filter": lambda shown: shown.show_assets().ask(),
    "problems": lambda shown: shown.show_assets().toggle_problems(),
    "prompt": lambda shown: shown.query_one(MissionPrompt).take_cursor(),
}
"""The actions that affect only the main screen, or a recording opened over it, by id."""

ON_RECORDING: Mapping[str, Callable[[RecordingScreen], object]] = {
    "play": RecordingScreen.play_pause,
    "step": lambda shown: shown.move(Player.step),
    "back": lambda shown: shown.move(Player.step_back),
    "second": lambda shown: shown.move(lambda player: player.step_seconds(1)),
    "second_back": lambda shown: shown.move(lambda player: player.step_seconds(-1)),
    "next_mission": lambda shown: shown.jump("mission", 1),
    "mission_before": lambda shown: shown.jump("mission", -1),
    "next_finding": lambda shown: shown.jump(FINDING, 1),
    "finding_before": lambda shown: shown.jump(FINDING, -1),
    "to_moment": RecordingScreen.to_moment,
    "search_log": RecordingScreen.search,
    "compare": RecordingScreen.compare,
}
"""The actions that are available only in a recording, by id."""

PaletteCommand = tuple[str, IgnoreReturnCallbackType, str, str]
"""The title, effect, help and further search words of a command."""


@dataclass(frozen=True)
class Controllers:
    """The controllers of the operator's actions, and the session with its screens."""

    session: ConsoleSession
    browsing: BrowsingController
    composing: ComposingController
    commands: CommandController
    approval: ApprovalController
    rules: RulesController
    settings: SettingsController
    leaving: LeavingController

    def carry_out(self, name: str) -> None:
        """Carry out an action with its controller, or else on the shown screen or recording."""
        shown = self.session.shown
        if name in HANDLERS:
            HANDLERS[name](self)
        elif name in ON_SCREEN and shown is not None:
            ON_SCREEN[name](shown)
        elif name in ON_RECORDING and isinstance(shown, RecordingScreen):
            ON_RECORDING[name](shown)


HANDLERS: Mapping[str, Callable[[Controllers], object]] = {
    "help": lambda to: to.browsing.show_help(),
    "manual": lambda to: to.browsing.show_manual(),
    "policies": lambda to: to.rules.browse(),
    "evaluation": lambda to: to.browsing.show_evaluation(),
    "sessions": lambda to: to.browsing.show_sessions(),
    "standing_orders": lambda to: to.commands.show_standing_orders(),
    "take_up": lambda to: to.commands.take_up(),
    "approval": lambda to: to.approval.go_to_it(),
    "cancel": lambda to: to.commands.attempt("Cancel", lambda station: station.cancel()),
    "stop": lambda to: to.commands.stop_all(),
    "release": lambda to: to.commands.release_stop(),
    "take_command": lambda to: to.leaving.take_command(),
    "acknowledge": lambda to: to.commands.acknowledge(),
    "sooner": lambda to: to.commands.with_queued("Move", lambda at, name: at.move(name, -1)),
    "later_queued": lambda to: to.commands.with_queued("Move", lambda at, name: at.move(name, 1)),
    "go_first": lambda to: to.commands.attempt("Let first", lambda at: at.let_next_go_first()),
    "defer": lambda to: to.commands.with_queued("Defer", lambda at, name: at.defer(name)),
    "withdraw": lambda to: to.commands.with_queued("Withdraw", lambda at, name: at.withdraw(name)),
    "mute_agent": lambda to: to.commands.mute_agent(),
    "follow": lambda to: to.browsing.follow_alarm(),
    "history": lambda to: to.composing.search_history(),
    "favourites": lambda to: to.composing.choose_favourite(),
    "keep_favourite": lambda to: to.composing.keep_favourite(),
    "thing": lambda to: to.composing.choose_thing(),
    "leave": lambda to: to.browsing.leave_field(),
    "earlier": lambda to: to.browsing.select_mission(-1),
    "later": lambda to: to.browsing.select_mission(1),
    "copy_trace": lambda to: to.browsing.copy_trace(),
    "screenshot": lambda to: to.browsing.take_screenshot(),
    "copy_plan": lambda to: to.browsing.copy_plan(),
    "faster": lambda to: to.commands.change_rate(2.0),
    "slower": lambda to: to.commands.change_rate(0.5),
    "settings": lambda to: to.settings.show(),
    "quit": lambda to: to.leaving.leave(),
}
"""The actions of the controllers, by id."""


class ConsoleHost(Protocol):
    """The part of the app that the palette uses."""

    controllers: Controllers


class ConsoleCommands(Provider):
    """The commands that are legal at this moment."""

    _what_ifs: tuple[WhatIf, ...] | None = None

    @property
    def _controllers(self) -> Controllers:
        return cast(ConsoleHost, self.app).controllers

    def _actions(self) -> Iterator[PaletteCommand]:
        now, keys = self._controllers.session.situation, self._controllers.settings.keys
        for action in ACTIONS:
            if action.palette and not action.refusal(now):
                run = partial(self.app.run_action, f"app.{action.action}")
                yield (
                    f"{action.help}  ({shown_keys(action, keys)})",
                    run,
                    action.group,
                    action.words,
                )

    def _simulation(self) -> Iterator[PaletteCommand]:
        session, commands = self._controllers.session, self._controllers.commands
        now = session.situation
        if now.replay or now.readonly:
            return
        for rate in RATES:
            yield f"Speed {rate:g}x", partial(commands.set_rate, rate), "Simulation", ""
        if self._what_ifs is None:
            self._what_ifs = tuple(what_ifs(session.world))
        for title, incident in self._what_ifs:
            yield title, partial(commands.inject, incident), "Simulation only", ""

    def _themes(self) -> Iterator[PaletteCommand]:
        for name in self.app.available_themes:
            yield f"Theme {name}", partial(setattr, self.app, "theme", name), "Colours", ""

    async def discover(self) -> Hits:
        """Yield the commands that are listed before anything is typed.

        They are all actions, the simulation speeds, and typical incidents.
        """
        for title, run, help_text, _ in self._actions():
            yield DiscoveryHit(title, run, help=help_text)
        for title, run, help_text, _ in self._simulation():
            if "Speed" in title or any(word in title for word in TYPICAL):
                yield DiscoveryHit(title, run, help=help_text)

    async def search(self, query: str) -> Hits:
        """Yield the matches of the typed text.

        A large site has thousands of entries for the simulation. Such an entry is matched only if
        its title contains every typed word.
        """
        matcher, words = self.matcher(query), query.lower().split()
        matches = (item for item in self._simulation() if _has(item[0].lower(), words))
        for title, run, help_text, others in (*self._actions(), *self._themes(), *matches):
            score = max(matcher.match(title), matcher.match(others))
            if score > 0:
                yield Hit(score, matcher.highlight(title), run, text=title, help=help_text)


def _has(title: str, words: list[str]) -> bool:
    return all(word in title for word in words)
