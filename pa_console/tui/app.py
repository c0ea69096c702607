"""The operator console, which connects the session, the screens and the controllers."""

import time
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path

from rich.segment import Segment
from textual import events, on
from textual.app import App
from textual.binding import Binding
from textual.color import Color
from textual.filter import LineFilter

from pa_console.policy.retriever import Retriever
from pa_console.schema.text import visible_line
from pa_console.schema.world import World
from pa_console.session.recording import Player
from pa_console.settings.sources import LoadedSettings, load_settings
from pa_console.station.assembly import Site, load_site
from pa_console.station.earlier.last_session import LastSession
from pa_console.terminal.output import PlainConsole
from pa_console.tui.actions import ActionContext, bindings, find_action, first_key, key_text
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.controllers.approval import ApprovalController, QuestionController
from pa_console.tui.controllers.attention import AttentionController, LogAlarmController
from pa_console.tui.controllers.browsing import BrowsingController
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.composing import ComposingController, Favourites, favourites_file
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.controllers import ConsoleCommands, Controllers
from pa_console.tui.controllers.leaving import LeavingController
from pa_console.tui.controllers.rules import RulesController
from pa_console.tui.controllers.session_feed import SessionFeed
from pa_console.tui.controllers.settings import SettingsController
from pa_console.tui.controllers.typing import KeyTime, TypingController
from pa_console.tui.kept_input import History, history_file
from pa_console.tui.recordings import OpenedLog
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.surroundings import JoinedTo, LiveStation, SecondsClock, ShownRules
from pa_console.tui.theme import VARIABLES, readable
from pa_console.tui.widgets.bars import JOINED
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionPrompt
from pa_console.tui.widgets.row_views import VirtualRows
from pa_console.views.waiting import Waiting

READ_ONLY = "READ-ONLY: every command is refused"


class VisibleLines(LineFilter):
    """A filter that shows control and invisible characters as escapes; a line keeps its width."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the line with control and invisible characters as escapes, cut to its width."""
        del background
        shown = [Segment(visible_line(text), style) for text, style, _ in segments]
        if all(new.text == old.text for new, old in zip(shown, segments, strict=True)):
            return segments
        return Segment.adjust_line_length(shown, Segment.get_line_length(segments))


def closed_by(joined: JoinedTo) -> str:
    """Return the reason why a console that shows another station's session takes no missions."""
    may = "you may countersign and stop" if joined.signer else "you may watch and stop"
    more = "" if joined.command_question is None else f"; {first_key('take_command')} takes command"
    return f"{joined.station} commands this session; / asks Why?; {may}{more}"


Opening = Callable[["ConsoleApp"], None]
"""A function that shows the first screens of a console."""


class ConsoleApp(App[None]):
    """The console of a live station, or of a recording's player, which refuses every command.

    `action_carry_out` receives every action of the registry. The handlers at the end of the class
    receive the messages of widgets. Controllers do the work.
    """

    TITLE = "PA Console"
    CSS_PATH = "console.tcss"
    BINDINGS = [*bindings(), Binding("ctrl+c", "help_quit", show=False, system=True, priority=True)]
    COMMANDS = {ConsoleCommands}

    def __init__(
        self,
        world: World,
        station: "LiveStation | None",
        rulebook: ShownRules,
        retriever: Retriever,
        *,
        readonly: bool = False,
        joined: JoinedTo | None = None,
        player: Player | None = None,
        clock: SecondsClock = time.monotonic,
        key_time: KeyTime = attrgetter("time"),
        history: Path | None = None,
        favourites: Path | None = None,
        copies: Path | None = None,
        evaluations: Path | None = None,
        settings: LoadedSettings | None = None,
        rules_file: Path | None = None,
        drafts: Path | None = None,
        opening: Opening | None = None,
        usual: Mapping[str, float] | None = None,
        to_terminal: Callable[[str], object] | None = None,
        last: LastSession | None = None,
        log: Path | None = None,
    ) -> None:
        """Build a live console over `station`, or a replay over `player`.

        A console that has `joined` another station's session commands no assets. Paths and settings
        that are None are the user's own, in the platform's folders. Rules can be edited if their
        `rules_file` is given. `opening` shows other screens instead of the session. `usual` maps
        each step of a mission to its usual duration in seconds. `to_terminal` receives the control
        codes that call the operator; by default, they go to the console's own terminal. Orders of
        the `last` session can be taken up again. The camera stills are stored beside the `log`.
        Tests replace `clock` and `key_time`. Raises DocumentError if the user's settings are
        invalid.
        """
        self._readable: dict[str, dict[str, str]] = {}
        super().__init__()
        self.error_console = PlainConsole(stderr=True)
        self._visible_lines = VisibleLines()
        self._history, self._opening, self._log_file = history, opening, log
        self.first_painted: Callable[[], object] = lambda: None
        """A callback that runs once, between the first paint and the first event."""
        self.session = session = ConsoleSession(
            self, world, station, player, readonly=readonly, clock=clock, joined=joined, last=last
        )
        user = SettingsController(session, settings or load_settings())
        rules = RulesController(session, rulebook, retriever, rules_file, drafts)
        self.feed = SessionFeed(session, Waiting(usual), rules.take, self._painted)
        commands = CommandController(session, self.feed)
        self._log_alarm = LogAlarmController(session)
        self._attention = AttentionController(session, user, to_terminal or self._to_terminal)
        self._typing = TypingController(session, user, key_time)
        browsing = BrowsingController(session, user, evaluations, copies)
        approval = ApprovalController(session, commands)
        self._questions = QuestionController(session, commands, approval)
        kept = Favourites(favourites or favourites_file())
        self.controllers = Controllers(
            session,
            browsing=browsing,
            composing=ComposingController(session, browsing, commands, user, kept),
            commands=commands,
            approval=approval,
            rules=rules,
            settings=user,
            leaving=LeavingController(session, user),
        )
        user.use_theme()
        self._first_colours: dict[str, str] | None = self.get_css_variables()
        self.stylesheet.set_variables(self._first_colours)

    # Overrides of Textual's App

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return Textual's filters and, last, the filter that makes every character visible."""
        return [*super().get_line_filters(), self._visible_lines]

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Return the console's values for colour variables that a theme does not define."""
        return VARIABLES

    def get_css_variables(self) -> dict[str, str]:
        """Return the theme's colours, with text colours that are adjusted for enough contrast."""
        theme = self.current_theme
        key = f"{theme.name} {theme.dark}"
        if key not in self._readable:
            given = super().get_css_variables()
            self._readable[key] = readable(given, dark=theme.dark, ansi=theme.ansi)
        return self._readable[key]

    def refresh_css(self, animate: bool = True) -> None:
        """Read all style sheets again, for example for another theme.

        The first call does nothing if the theme has not changed since the constructor, because the
        style sheets are then read with that theme anyway. Reading them twice would make the first
        paint take a tenth longer.
        """
        first, self._first_colours = self._first_colours, None
        if first != self.get_css_variables():
            super().refresh_css(animate)

    def get_key_display(self, binding: Binding) -> str:
        """Return the text for a key, the same in the footer and in the help."""
        return key_text(binding.key)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Allow a registered action only while it is legal; otherwise, the footer hides it."""
        registered = find_action(action, parameters)
        if registered is not None and not self.session.allows(registered):
            return False
        return super().check_action(action, parameters)

    async def on_event(self, event: events.Event) -> None:
        """Handle an event, except for a key that the typing controller takes."""
        if isinstance(event, events.InputEvent) and not event.is_forwarded:
            if isinstance(event, events.MouseDown):
                self._typing.forget()
            elif isinstance(event, events.Key) and await self._typing.takes(event):
                return
        await super().on_event(event)

    def action_carry_out(self, name: str) -> None:
        """Carry out the action with the id `name`."""
        self.controllers.carry_out(name)

    def action_help_quit(self) -> None:
        """Show how to leave the console; `^c` copies the selection and never leaves."""
        self.controllers.leaving.say_how()

    # Properties for screens and the palette

    @property
    def situation(self) -> ActionContext:
        """The state that decides which actions are legal now."""
        return self.session.situation

    @property
    def keys(self) -> Mapping[str, str]:
        """The user's own keys, by the names of the actions."""
        return self.controllers.settings.keys

    # The start

    def on_mount(self) -> None:
        """Show the first screen; the session starts after the first paint."""
        if self._opening is not None:
            self._opening(self)
        else:
            self.show_session()
        self.call_after_refresh(self._start)

    def show_session(self) -> None:
        """Show the main screen of the live session, or of the recording."""
        session, rules = self.session, self.controllers.rules.texts
        if session.player is not None:
            main = RecordingScreen(session.world, rules, session.player, session.clock)
        else:
            mode, closed = ("READ-ONLY", READ_ONLY) if session.readonly else ("LIVE", "")
            if session.joined is not None:
                mode, closed = f"{JOINED} {session.joined.station}", closed_by(session.joined)
            kept = self.controllers.settings.loaded.values.history_kept
            session.typed = History(None if closed else self._history or history_file(), kept)
            main = MainScreen(
                session.world,
                rules,
                session.typed,
                closed=closed,
                mode=mode,
                clock=session.clock,
                joined=session.joined,
            )
            main.log_file = self._log_file
        session.main = main
        self.push_screen(main)

    def _start(self) -> None:
        self.first_painted()
        self.controllers.settings.use(self.controllers.settings.loaded)
        self.feed.start()
        self.controllers.leaving.watch_terminal()
        self._log_alarm.watch_screens()

    def _to_terminal(self, codes: str) -> None:
        if not self.is_headless and self._driver is not None:
            self._driver.write(codes)

    def _painted(self) -> None:
        self._attention.look()
        self.controllers.approval.close_void()
        self.controllers.approval.look_ahead()
        self._log_alarm.show()

    def on_unmount(self) -> None:
        """Restore the title of the terminal's window."""
        self._attention.leave()

    # Messages of widgets

    @on(VirtualRows.RowChosen)
    def _row_chosen(self, message: VirtualRows.RowChosen) -> None:
        self.controllers.composing.row_chosen(message)

    @on(MapView.Picked)
    def _picked(self, message: MapView.Picked) -> None:
        self.controllers.composing.picked(message.names, message.at, menu=message.menu)

    @on(MissionPrompt.Typed)
    def _typed(self, message: MissionPrompt.Typed) -> None:
        self.controllers.commands.typing(message.text)

    @on(MissionPrompt.Given)
    def _given(self, message: MissionPrompt.Given) -> None:
        self._questions.take(message.text)

    @on(ApprovalPanel.Decided)
    def _decided(self, message: ApprovalPanel.Decided) -> None:
        self.controllers.approval.decide(message.decision)

    @on(ApprovalPanel.LookedAt)
    def _looked_at(self, message: ApprovalPanel.LookedAt) -> None:
        self.controllers.approval.look_at(message.asked)

    @on(ApprovalPanel.Asked)
    def _asked(self, message: ApprovalPanel.Asked) -> None:
        if message.wish == "modify":
            self.controllers.approval.modify()
        else:
            self.controllers.approval.compare()


def comparison(a: OpenedLog, b: OpenedLog) -> Opening:
    """Return an opening that compares `a` with `b`; Escape leads to the recording of `a`."""

    def show(app: ConsoleApp) -> None:
        app.show_session()
        from pa_console.tui.screens.compare import CompareScreen  # noqa: PLC0415 - not at start

        app.push_screen(CompareScreen(a, b, app.session.clock))

    return show


def evaluation(folder: Path) -> Opening:
    """Return an opening that shows the evaluation in `folder` without a session; q leaves it."""

    def show(app: ConsoleApp) -> None:
        from pa_console.tui.screens.evaluation import EvaluationScreen  # noqa: PLC0415

        app.push_screen(EvaluationScreen(folder, app.session.clock, over=False))

    return show


def evaluation_console(
    folder: Path, site: Site, *, copies: Path | None = None, settings: LoadedSettings | None = None
) -> ConsoleApp:
    """Return a read-only console that shows the evaluation in `folder`.

    Its policy browser shows the rules of `site`. `copies` and `settings` are passed to the console.
    """
    return ConsoleApp(
        site.world,
        None,
        site.rulebook,
        Retriever(site.rulebook.rules),
        readonly=True,
        copies=copies,
        settings=settings,
        opening=evaluation(folder),
    )


def show_evaluation(folder: Path, settings: LoadedSettings) -> None:
    """Show the evaluation in `folder` on the screen until the operator leaves it."""
    site = load_site("checkpoint", "checkpoint")
    evaluation_console(folder, site, settings=settings).run(mouse=settings.values.mouse)
