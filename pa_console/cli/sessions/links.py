"""A look at the robots on a link, for `doctor` and `world from`; nothing is commanded."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import monotonic

from pa_console.fleets.link import Discovering, FoundRobot, LinkNews, LinkNotice, open_link
from pa_console.fleets.reports import AssetReport
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

LOOK_S = 5.0
"""The longest look at a link, seconds."""

POLL_S = 0.1


@dataclass(frozen=True)
class LinkSurvey:
    """The state of a link after a look at it."""

    name: str
    problem: str
    """The reason why there is no connection, '' while there is one."""
    agents: frozenset[str]
    """The assets of the world that are on it."""
    reports: dict[str, AssetReport]
    """The latest report of each asset that sent one."""
    notices: tuple[str, ...]
    found: tuple[FoundRobot, ...]
    """Every robot on it; none where the link finds no robots of itself."""

    @property
    def silent(self) -> list[str]:
        """The assets that have not reported."""
        return sorted(self.agents - self.reports.keys())

    def in_words(self) -> str:
        """Return the robots on the link, in one line."""
        parts = [f"no connection: {self.problem}"] if self.problem else ["connected"]
        if self.reports:
            parts.append(f"reports from {', '.join(sorted(self.reports))}")
        if self.silent:
            parts.append(f"nothing from {', '.join(self.silent)}")
        if others := [robot for robot in self.found if robot.name not in self.agents]:
            named = [f"{robot.name} ({robot.kind})" for robot in others]
            parts.append(f"not in the world: {', '.join(named)}")
        return f"{self.name}: {'; '.join([*parts, *self.notices])}"


def survey(url: str, world: World, settings: Settings, seconds: float = LOOK_S) -> LinkSurvey:
    """Look at the link at `url` for `seconds`, less where all there is has reported.

    Raises ValueError for a link that cannot be opened.
    """
    link = open_link(url, world, settings)
    try:
        until, news = monotonic() + seconds, list[LinkNews](link.take())
        finds = isinstance(link, Discovering)
        while (left_s := until - monotonic()) > 0.0 and (finds or link.agents - _heard(news)):
            link.wait(min(left_s, POLL_S))
            news += link.take()
        return LinkSurvey(
            link.name,
            link.problem,
            link.agents,
            {each.agent: each for each in news if isinstance(each, AssetReport)},
            tuple(dict.fromkeys(n.text for n in news if isinstance(n, LinkNotice))),
            tuple(link.discover()) if isinstance(link, Discovering) else (),
        )
    finally:
        link.close()


def _heard(news: Sequence[LinkNews]) -> set[str]:
    return {each.agent for each in news if isinstance(each, AssetReport)}
