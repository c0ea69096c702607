"""Robots found on a bus or a link: a look at them, and a world that has them as assets.

A look commands nothing.
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
    open_link,
)
from pa_console.fleets.reports import AssetReport
from pa_console.schema.base import Name, Point
from pa_console.schema.world import AssetSpec, Background, Frame, World
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.world_file import geometry_problems

_NAME: TypeAdapter[str] = TypeAdapter(Name)


def with_robots(
    world: World, found: Iterable[FoundRobot]
) -> tuple[Mapping[str, AssetSpec], tuple[str, ...]]:
    """Return the robots of `found` that can be new assets of `world`, and a line about each.

    Each has the platform of its kind, and is posted at the nearest place if its own is known.
    """
    added: dict[str, AssetSpec] = {}
    told: list[str] = []
    for robot in found:
        name = robot.name
        if name in world.assets or name in world.cameras or name in added:
            continue
        try:
            _NAME.validate_python(name)
        except ValidationError:
            told.append(f"{name} cannot join: that is no name of an asset, such as Robot_T03")
            continue
        if robot.kind not in world.platforms:
            told.append(f"{name} cannot join: this world has no platform for a {robot.kind}")
            continue
        added[name] = AssetSpec(kind=robot.kind, post=_post(world, robot))
        told.append(f"{name}{f' {robot.detail}' if robot.detail else ''} joins as a {robot.kind}")
    return added, tuple(told)


MARGIN_M = 5.0
"""The least distance from a place to the perimeter of a world that is made around places."""

MOST_RADIUS_M = 8.0


def world_of_robots(
    base: World, present: Collection[str], found: Iterable[FoundRobot]
) -> tuple[World, tuple[str, ...]]:
    """Return `base` with the robots that are there, and a line about each new one.

    They are the assets of `base` that are `present`, and those of `found`. Raises ValueError for
    a world without robots, or with more of them than there is room for.
    """
    added, told = with_robots(base, found)
    known = {name: spec for name, spec in base.assets.items() if name in present}
    if not known and not added:
        raise ValueError("no robot was found: switch one on, and see its address and its name")
    assets = {**known, **added}
    aliases = _aliases(base, {*base.frames, *base.zones, *assets})
    world = base.model_copy(update={"assets": assets, "aliases": aliases})
    for field, problem in geometry_problems(world):
        raise ValueError(f"{'.'.join(map(str, field))}: {problem}")
    return world, told


def around_places(
    base: World, title: str, places: Mapping[str, Frame], background: Background | None
) -> World:
    """Return a world of these places, with the platforms and limits of `base`, and no barrier.

    Its perimeter encloses the places and the background. Raises ValueError for places that make no
    world, such as none of the kind `gate`.
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
        said = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise ValueError(f"--place: {said}") from error


def _aliases(base: World, names: Collection[str]) -> dict[str, str]:
    """Return the aliases of `base` for those of `names`."""
    return {alias: name for alias, name in base.aliases.items() if name in names}


def places_of(written: Iterable[str]) -> dict[str, Frame]:
    """Return the places of NAME=X,Y[,KIND] in metres, KIND gate, post or base; post by default.

    A place reaches as far as it can without meeting another one, 8 m at most. Raises ValueError
    naming the one that cannot be read.
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
    found: dict[str, Frame] = {}
    for name, point in at.items():
        gap = min((dist(point, other) for n, other in at.items() if n != name), default=1e9)
        frame = {"kind": kinds[name], "at": point, "radius_m": min(MOST_RADIUS_M, 0.49 * gap)}
        try:
            found[name] = Frame.model_validate(frame)
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            field = ".".join(map(str, wrong["loc"]))
            raise ValueError(f"--place {name}: {field}: {wrong['msg']}") from error
    return found


def _enclosing(corners: Iterable[Point]) -> tuple[Point, ...]:
    """Return the rectangle around the corners, with a margin."""
    xs, ys = zip(*corners, strict=True)
    west, east = min(xs) - MARGIN_M, max(xs) + MARGIN_M
    south, north = min(ys) - MARGIN_M, max(ys) + MARGIN_M
    return (west, south), (east, south), (east, north), (west, north)


def _post(world: World, robot: FoundRobot) -> str:
    """Return the place nearest to a robot, the base while its own is unknown."""
    at = robot.position
    if at is None:
        return world.base
    return min(world.frames, key=lambda name: dist(world.frames[name].at, at))


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
    findings: tuple[LinkFinding, ...] = ()
    """The set-up of its robots, if that was asked for."""

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


def survey(
    url: str, world: World, settings: Settings, seconds: float = LOOK_S, *, examine: bool = False
) -> LinkSurvey:
    """Look at the link at `url` for `seconds`, less where all there is has reported.

    With `examine`, the set-up of its robots is looked at too.

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
            tuple(link.examine(LOOK_S)) if examine and isinstance(link, Examined) else (),
        )
    finally:
        link.close()


def _heard(news: Sequence[LinkNews]) -> set[str]:
    return {each.agent for each in news if isinstance(each, AssetReport)}
