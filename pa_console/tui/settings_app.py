"""The half of the app that follows the user's settings: theme, keys, delays."""

from pa_console.settings.sources import Loaded
from pa_console.tui.keymap import KeymapError, check_keys
from pa_console.tui.rules_app import RulesApp
from pa_console.tui.theme import DEFAULT_THEME, THEMES, VARIABLES


class SettingsApp(RulesApp):
    """Puts the settings in force, at the start and whenever the settings screen has saved one."""

    settings: Loaded
    """What is in force; whoever builds the app gives it."""

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Return the console's own colour variables for themes without them."""
        return VARIABLES

    def use_theme(self) -> None:
        """Show the chosen colours, before anything is painted."""
        for theme in THEMES:
            self.register_theme(theme)
        chosen = self.settings.values.theme
        self.theme = chosen if chosen in self.available_themes else DEFAULT_THEME

    def use_settings(self, settings: Loaded) -> None:
        """Put everything in force that needs no restart; what cannot be used is told."""
        shown, self.settings = self.settings.values.theme, settings
        values = settings.values
        if values.theme != shown:  # else the one that was picked meanwhile stays
            self.use_theme()
        if values.theme not in self.available_themes:
            problem = f"there is no theme {values.theme!r}; the settings list them"
            self._cannot_use("theme", str(settings.error(("theme",), problem)))
        try:
            check_keys(values.keys)
        except KeymapError as error:
            self._cannot_use("keys", str(settings.error(("keys", error.name), error.problem)))
        else:
            self.keys = dict(values.keys)
            self.set_keymap(self.keys)
        if self.main is not None:
            self.main.use_delays(values.approval_delay_s, values.stale_after_s)

    def _cannot_use(self, what: str, problem: str) -> None:
        self.tell(problem, f"Your {what} cannot be used; the console's own is", bad=True)

    def action_settings(self) -> None:
        """Show the settings."""
        from pa_console.tui.screens.settings import SettingsScreen  # noqa: PLC0415

        if not any(isinstance(screen, SettingsScreen) for screen in self.screen_stack):
            self.push_screen(SettingsScreen(self.settings, self.use_settings))
