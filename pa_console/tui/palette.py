"""The command palette: the registry's actions that are legal now, what-ifs and speeds."""

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, cast

from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.types import IgnoreReturnCallbackType

from pa_console.tui.actions import ACTIONS, shown_keys
from pa_console.tui.controllers.commands import RATES, WhatIf, what_ifs

if TYPE_CHECKING:
    from pa_console.tui.app import ConsoleApp

TYPICAL = ("unknown vehicle", "weather")
"""Words of the what-ifs that are offered before anything is typed."""

PaletteCommand = tuple[str, IgnoreReturnCallbackType, str, str]
"""Title, effect, help, and further search words."""


class ConsoleCommands(Provider):
    """Offers the commands that are legal at this moment."""

    _what_ifs: tuple[WhatIf, ...] | None = None

    @property
    def _host(self) -> "ConsoleApp":
        return cast("ConsoleApp", self.app)

    def _actions(self) -> Iterator[PaletteCommand]:
        now, keys = self._host.session.situation, self._host.controllers.settings.keys
        for action in ACTIONS:
            if action.palette and not action.refusal(now):
                run = partial(self.app.run_action, f"app.{action.action}")
                yield (
                    f"{action.help}  [{shown_keys(action, keys)}]",
                    run,
                    action.group,
                    action.words,
                )

    def _simulation(self) -> Iterator[PaletteCommand]:
        session, commands = self._host.session, self._host.controllers.commands
        now = session.situation
        if now.replay or now.readonly:
            return
        for rate in RATES:
            yield f"Speed {rate:g}x", partial(commands.set_rate, rate), "Simulation", ""
        if self._what_ifs is None:
            self._what_ifs = tuple(what_ifs(session.world))
        for title, incident in self._what_ifs:
            yield title, partial(commands.inject, incident), "Simulation only", ""

    async def discover(self) -> Hits:
        """Yield the actions, and the what-ifs that start a typical situation."""
        for title, run, help_text, _ in self._actions():
            yield DiscoveryHit(title, run, help=help_text)
        for title, run, help_text, _ in self._simulation():
            if "Speed" in title or any(word in title for word in TYPICAL):
                yield DiscoveryHit(title, run, help=help_text)

    async def search(self, query: str) -> Hits:
        """Yield the matches of the typed text.

        In the simulation's part, thousands of entries long on a large site, every word has to occur
        as it is.
        """
        matcher, words = self.matcher(query), query.lower().split()
        found = (item for item in self._simulation() if _has(item[0].lower(), words))
        for title, run, help_text, others in (*self._actions(), *found):
            score = max(matcher.match(title), matcher.match(others))
            if score > 0:
                yield Hit(score, matcher.highlight(title), run, text=title, help=help_text)


def _has(title: str, words: list[str]) -> bool:
    return all(word in title for word in words)
