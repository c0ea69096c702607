"""Surveys of the robots on a link, and worlds in which discovered robots are assets.

A survey sends no command.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import dist
from time import monotonic

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.link import (
    Discovering,
    Examined,
    FoundRobot,
    LinkFinding,
    LinkNews,
    LinkNotice,
    Listener,
)
from pa_console.fleets.reports import AssetReport
from pa_console.schema.base import Name, Point
from pa_console.schema.world import AssetSpec, Background, Frame, World
from pa_console.sim.worlds.world_file import geometry_problems

MARGIN_M = 5.0
"""The margin of a new world's perimeter around its places, in metres."""

MOST_RADIUS_M = 8.0
"""The largest radius of a place in a new world, in metres."""

LOOK_S = 5.0
"""The longest survey of a link, in seconds."""

POLL_S = 0.1
"""The longest wait for news before the end of a survey is checked, in seconds."""

_NAME: TypeAdapter[str] = TypeAdapter(Name)


def with_robots(
    world: World, robots: Iterable[FoundRobot]
) -> tuple[Mapping[str, AssetSpec], tuple[str, ...]]:
    """Return the `robots` that can become assets of `world`, and a line about each of them.

    A robot gets the platform of its kind. Its post is the frame nearest to it, or the base if its
    position is unknown.
    """
    added: dict[str, AssetSpec] = {}
    lines: list[str] = []
    for robot in robots:
        name = robot.name
        if name in world.assets or name in world.cameras or name in added:
            continue
        try:
            _NAME.validate_python(name)
        except ValidationError:
            lines.append(f"{name} cannot join: an asset needs a name such as Robot_T03")
            continue
        if robot.kind not in world.platforms:
            lines.append(f"{name} cannot join: this world has no platform for a {robot.kind}")
            continue
        added[name] = AssetSpec(kind=robot.kind, post=_post(world, robot))
        lines.append(f"{name}{f' {robot.detail}' if robot.detail else ''} joins as a {robot.kind}")
    return added, tuple(lines)


def world_of_robots(
    base: World, present: Collection[str], robots: Iterable[FoundRobot]
) -> tuple[World, tuple[str, ...]]:
    """Return `base` with only the discovered robots as assets, and a line about each new one.

    The assets are those of `base` that are `present`, and the new ones in `robots`. Raises
    ValueError if there is no robot, or if the world has no room for all of them.
    """
    added, lines = with_robots(base, robots)
    kept = {name: spec for name, spec in base.assets.items() if name in present}
    if not kept and not added:
        raise ValueError("no robot was found: switch one on, and check its address and its name")
    assets = {**kept, **added}
    aliases = _aliases(base, {*base.frames, *base.zones, *assets})
    world = base.model_copy(update={"assets": assets, "aliases": aliases})
    for field, problem in geometry_problems(world):
        raise ValueError(f"{'.'.join(map(str, field))}: {problem}")
    return world, lines


def around_places(
    base: World, title: str, places: Mapping[str, Frame], background: Background | None
) -> World:
    """Return a world with `places` as frames, and without walls, lanes, zones or cameras.

    It has the platforms and limits of `base`. The perimeter encloses the places and the background.
    Raises ValueError if the places do not make a valid world, for example without a `gate`.
    """
    corners = [frame.at for frame in places.values()]
    if background is not None:
        (west, south), (east, north) = background.origin, background.size_m
        corners += [(west, south), (west + east, south + north)]
    document = base.model_dump(exclude={"walls", "lanes", "zones", "cameras", "origin"})
    document |= {
        "name": "from_robots",
        "title": title,
        "perimeter": _enclosing(corners),
        "frames": {name: frame.model_dump() for name, frame in places.items()},
        "background": background.model_dump() if background is not None else None,
    }
    home = next((name for name, frame in places.items() if frame.kind == "base"), "")
    document["aliases"] = _aliases(base, {*places, *base.assets})
    document["assets"] = {
        name: {**spec.model_dump(), "post": home} for name, spec in base.assets.items()
    }
    try:
        return World.model_validate(document)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise ValueError(f"--place: {problem}") from error


def _aliases(base: World, names: Collection[str]) -> dict[str, str]:
    """Return the aliases of `base` that refer to one of `names`."""
    return {alias: name for alias, name in base.aliases.items() if name in names}


def places_of(written: Iterable[str]) -> dict[str, Frame]:
    """Return the frames for texts of the form NAME=X,Y[,KIND], with X and Y in metres.

    KIND is gate, post or base; post by default. The radius of a frame is as large as possible
    without overlap, at most MOST_RADIUS_M. Raises ValueError with the text that is not valid.
    """
    kinds: dict[str, str] = {}
    at: dict[str, Point] = {}
    for word in written:
        name, sign, rest = word.partition("=")
        x, y, *kind = rest.split(",")[:4] if sign and "," in rest else ("", "")
        try:
            at[name], kinds[name] = (float(x), float(y)), kind[0] if kind else "post"
        except ValueError:
            raise ValueError(f"--place {word}: give NAME=X,Y or NAME=X,Y,KIND") from None
    frames: dict[str, Frame] = {}
    for name, point in at.items():
        gap = min((dist(point, other) for n, other in at.items() if n != name), default=1e9)
        frame = {"kind": kinds[name], "at": point, "radius_m": min(MOST_RADIUS_M, 0.49 * gap)}
        try:
            frames[name] = Frame.model_validate(frame)
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            field = ".".join(map(str, wrong["loc"]))
            raise ValueError(f"--place {name}: {field}: {wrong['msg']}") from error
    return frames


def _enclosing(corners: Iterable[Point]) -> tuple[Point, ...]:
    """Return the rectangle around `corners` with a margin of MARGIN_M."""
    xs, ys = zip(*corners, strict=True)
    west, east = min(xs) - MARGIN_M, max(xs) + MARGIN_M
    south, north = min(ys) - MARGIN_M, max(ys) + MARGIN_M
    return (west, south), (east, south), (east, north), (west, north)


def _post(world: World, robot: FoundRobot) -> str:
    """Return the frame nearest to `robot`, or the base if its position is unknown."""
    at = robot.position
    if at is None:
        return world.base
    return min(world.frames, key=lambda name: dist(world.frames[name].at, at))


@dataclass(frozen=True)
class LinkSurvey:
    """The result of a survey of one link."""

    name: str
    problem: str
    """The reason why there is no connection; '' if there is one."""
    agents: frozenset[str]
    """The assets of the world on this link."""
    reports: dict[str, AssetReport]
    """The latest report of each asset that sent one."""
    notices: tuple[str, ...]
    found: tuple[FoundRobot, ...]
    """Every robot on the link; empty if the link cannot discover robots."""
    findings: tuple[LinkFinding, ...] = ()
    """The findings about the configuration of the robots, if they were examined."""

    @property
    def silent(self) -> list[str]:
        """The assets that have not reported."""
        return sorted(self.agents - self.reports.keys())

    def in_words(self) -> str:
        """Return one line about the connection and the robots on the link."""
        parts = [f"no connection: {self.problem}"] if self.problem else ["connected"]
        if self.reports:
            parts.append(f"reports from {', '.join(sorted(self.reports))}")
        if self.silent:
            parts.append(f"nothing from {', '.join(self.silent)}")
        if others := [robot for robot in self.found if robot.name not in self.agents]:
            named = [f"{robot.name} ({robot.kind})" for robot in others]
            parts.append(f"not in the world: {', '.join(named)}")
        return f"{self.name}: {'; '.join([*parts, *self.notices])}"


def survey(link: Listener, seconds: float = LOOK_S, *, examine: bool = False) -> LinkSurvey:
    """Survey `link` for `seconds`, close it, and return the result.

    The survey ends early once every asset has reported, unless the link discovers robots. With
    `examine`, the configuration of the robots is examined too.
    """
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
            tuple(dict.fromkeys(_line(n, link.name) for n in news if isinstance(n, LinkNotice))),
            tuple(link.discover()) if isinstance(link, Discovering) else (),
            tuple(link.examine(LOOK_S)) if examine and isinstance(link, Examined) else (),
        )
    finally:
        link.close()


def _heard(news: Sequence[LinkNews]) -> set[str]:
    return {each.agent for each in news if isinstance(each, AssetReport)}


def _line(notice: LinkNotice, link: str) -> str:
    return notice.text if notice.subject == link else f"{notice.subject} {notice.text}"
