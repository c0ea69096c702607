"""The link protocol: what connects robots of one kind, such as ROS 2 or MAVLink, to a fleet.

A package adds a kind of robots by an entry point in the group `pa_console.fleets`, named after the
scheme of its addresses: `--fleet SCHEME:ADDRESS`. `LinkedFleet` makes one fleet of several links.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol, runtime_checkable

from pa_console.fleets.reports import AssetReport, SensorReport
from pa_console.resources import install_hint
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand, ReplyStatus
from pa_console.schema.events.event import Level
from pa_console.schema.world import AssetKind, Background, World
from pa_console.settings.schema import Settings


@dataclass(frozen=True)
class DeviceAnswer:
    """An asset's answer to a command; `detail` gives the asset's own reason where it has one."""

    command_id: str
    agent: str
    status: ReplyStatus
    detail: str = ""


@dataclass(frozen=True)
class LinkNotice:
    """A line for the operator about `subject`, an asset or the link."""

    level: Level
    subject: str
    text: str


@dataclass(frozen=True)
class NotReady:
    """The reason that a reporting asset cannot start yet, '' once it can."""

    agent: str
    why: str


@dataclass(frozen=True)
class GroundMap:
    """A map that robots have made of the ground, in the world's frame; the newest one counts."""

    background: Background


LinkNews = AssetReport | SensorReport | DeviceAnswer | LinkNotice | NotReady | GroundMap


@dataclass(frozen=True)
class FoundRobot:
    """A robot that a link has discovered; `name` is what its asset would be called."""

    name: str
    kind: AssetKind
    position: Point | None = None
    """Metres in the world's frame, None while unknown."""
    detail: str = ""
    """Its own description, such as its type or its namespace."""


class Link(Protocol):
    """A connection to some assets of a world, with threads of its own.

    No member raises, and only `wait` and `close` take time. A command id is carried out at most
    once, and its last answer is given again if it is sent again; a hold is carried out each time.
    Without a connection nothing is kept to be sent later. `acknowledged` or `refused` come first,
    then `done` or `failed`; a hold is `done` once the asset reports that it stands.
    """

    @property
    def name(self) -> str:
        """The name on the screen, such as `ros2:robots.yaml`."""
        ...

    @property
    def agents(self) -> frozenset[str]:
        """The assets of the world that are commanded over this link; they do not change."""
        ...

    @property
    def problem(self) -> str:
        """The reason why there is no connection, '' while there is one."""
        ...

    def send(self, command: DeviceCommand) -> None:
        """Send `command` to its asset; returns at once and raises nothing."""
        ...

    def take(self) -> Sequence[LinkNews]:
        """Return what came in since the last call, in order of arrival."""
        ...

    def wait(self, seconds: float) -> bool:
        """Wait until there is news, for `seconds` at most; return whether there is."""
        ...

    def close(self) -> None:
        """End the connection; no further member is called."""
        ...


@runtime_checkable
class Discovering(Link, Protocol):
    """A link that finds robots which the world does not have."""

    def discover(self) -> Sequence[FoundRobot]:
        """Return every robot on the link so far, those of the world among them."""
        ...


@dataclass(frozen=True)
class LinkFinding:
    """One thing that was looked at on a robot, such as a message or a parameter of it."""

    agent: str
    what: str
    found: str
    wanted: str = ""
    """The value as it should be, '' if it is."""
    consequence: str = ""
    """The effect of the wrong value, '' if nothing is wrong."""

    def unless(self, good: object, wanted: str, consequence: str) -> "LinkFinding":
        """Return it as it is if it is `good`, else with what it should be and the consequence."""
        return self if good else replace(self, wanted=wanted, consequence=consequence)


@runtime_checkable
class Examined(Link, Protocol):
    """A link that can report what its robots send and how they are configured."""

    def examine(self, seconds: float) -> Sequence[LinkFinding]:
        """Look at every robot, for `seconds` at most; nothing is commanded."""
        ...


OpenLink = Callable[[str, World, Settings], Link]
"""The function of an entry point: returns the link to an ADDRESS, for the assets of a world.

It raises ValueError with a remedy for an address it cannot use, and if nothing answers there.
"""

GROUP = "pa_console.fleets"
OWN = (
    EntryPoint("ros2", "pa_console.fleets.ros2.link:open_link", GROUP),
    EntryPoint("mavlink", "pa_console.fleets.mavlink.link:open_link", GROUP),
)
"""The console's own links; MAVLink needs the extra of its name, ROS 2 an installation of it."""

BUS = ("mqtt", "mqtts")
"""The schemes of robots on a message bus (VDA 5050), which have a fleet of their own."""


@cache
def link_schemes() -> dict[str, EntryPoint]:
    """Return the entry point of each scheme; no package takes the place of the console's own."""
    return {point.name: point for point in (*entry_points(group=GROUP), *OWN)}


def open_link(url: str, world: World, settings: Settings) -> Link:
    """Return the link at `url`, SCHEME:ADDRESS, for the assets of `world`.

    Raises ValueError with the remedy for an unknown scheme, a missing library, and what the link's
    own package finds wrong.
    """
    scheme, _, address = url.partition(":")
    point = link_schemes().get(scheme)
    if point is None:
        known = ", ".join(
            [f"{bus}://HOST/SITE" for bus in BUS] + [f"{s}:..." for s in link_schemes()]
        )
        raise ValueError(
            f"--fleet {url}: there is no link {scheme!r}; give one of {known}, or install the "
            f"package that adds it (entry point {GROUP!r})"
        )
    try:
        opener: OpenLink = point.load()
    except ModuleNotFoundError as error:
        remedy = f": {install_hint(scheme)}" if point in OWN else ""
        raise ValueError(
            f"--fleet {url} needs a library that is not installed ({error.name}){remedy}"
        ) from error
    except (ImportError, AttributeError) as error:
        raise ValueError(f"--fleet {url}: {point.value} cannot be loaded: {error}") from error
    return opener(address, world, settings)
