"""The user's settings in force: theme, keys and delays."""

from collections.abc import Mapping

from pa_console.settings.sources import LoadedSettings
from pa_console.tui.actions import KeymapError, check_keys
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.theme import DEFAULT_THEME, THEMES


class SettingsController:
    """The controller that applies the settings, at the start and after each saved change."""

    def __init__(self, session: ConsoleSession, loaded: LoadedSettings) -> None:
        """Begin with `loaded`, the settings in force."""
        self._session, self._app = session, session.app
        self.loaded = loaded
        self.keys: Mapping[str, str] = {}
        """The user's own keys, by the names of the actions."""

    def use_theme(self) -> None:
        """Use the chosen theme before anything is painted."""
        for theme in THEMES:
            self._app.register_theme(theme)
        chosen = self.loaded.values.theme
        self._app.theme = chosen if chosen in self._app.available_themes else DEFAULT_THEME

    def use(self, loaded: LoadedSettings) -> None:
        """Apply all settings that need no restart; show the unusable ones."""
        shown, self.loaded = self.loaded.values.theme, loaded
        values = loaded.values
        if values.theme != shown:  # otherwise, keep a theme picked meanwhile
            self.use_theme()
        if values.theme not in self._app.available_themes:
            problem = f"there is no theme “{values.theme}”; the settings list them"
            self._cannot_use("theme", str(loaded.error(("theme",), problem)))
        try:
            check_keys(values.keys)
        except KeymapError as error:
            self._cannot_use("keys", str(loaded.error(("keys", error.name), error.problem)))
        else:
            self.keys = dict(values.keys)
            self._app.set_keymap(self.keys)
        if self._session.main is not None:
            self._session.main.use_delays(values.approval_delay_s, values.stale_after_s)
            self._session.main.name_keys()
        if self._session.station is not None:
            self._session.station.read_live(self._show_reading if values.live_reading else None)

    def _show_reading(self, text: str, reading: str) -> None:
        """Show the reading of the `text` being typed, after the current message is handled."""
        if self._session.main is not None:
            self._app.call_later(self._session.main.show_reading, text, reading)

    def _cannot_use(self, setting: str, problem: str) -> None:
        title = f"Your {setting} cannot be used; the default applies"
        self._session.tell(problem, title, bad=True)

    def show(self) -> None:
        """Show the settings."""
        from pa_console.tui.screens.settings import SettingsScreen  # noqa: PLC0415

        if not self._session.is_open(SettingsScreen):
            self._app.push_screen(SettingsScreen(self.loaded, self.use))
