"""The link protocol: a connection of a fleet to robots of one kind, such as ROS 2 or MAVLink.

A package adds a kind of robot with an entry point in the group `pa_console.fleets`. The name of
the entry point is the scheme of its addresses: `--fleet SCHEME:ADDRESS`. `LinkedFleet` combines
several links into one fleet.
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

GROUP = "pa_console.fleets"
OWN = (
    EntryPoint("ros2", "pa_console.fleets.ros2.link:open_link", GROUP),
    EntryPoint("mavlink", "pa_console.fleets.mavlink.link:open_link", GROUP),
)
"""The console's own links. MAVLink needs the extra `mavlink`; ROS 2 must be installed."""

BUS = ("mqtt", "mqtts")
"""The schemes of a message bus (VDA 5050), which has a fleet class of its own."""


@dataclass(frozen=True)
class DeviceAnswer:
    """An asset's answer to a command; `detail` is the asset's own reason, if it gives one."""

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
    """The reason why an asset that reports cannot start yet; '' once it can."""

    agent: str
    why: str


@dataclass(frozen=True)
class GroundMap:
    """A map of the ground that robots have made, in the world's frame; the newest one is shown."""

    background: Background


LinkNews = AssetReport | SensorReport | DeviceAnswer | LinkNotice | NotReady | GroundMap


@dataclass(frozen=True)
class FoundRobot:
    """A robot that a link has discovered; `name` is the name that its asset would get."""

    name: str
    kind: AssetKind
    position: Point | None = None
    """The position in metres in the world's frame; None while it is unknown."""
    detail: str = ""
    """A description from the robot, such as its type or its namespace."""


class Listener(Protocol):
    """A connection that reports on some assets of a world, with its own threads.

    No member raises an exception, and only `wait` and `close` take time.
    """

    @property
    def name(self) -> str:
        """The name of the link on the screen, such as `ros2:robots.yaml`."""
        ...

    @property
    def agents(self) -> frozenset[str]:
        """The assets of the world on this link; the set does not change."""
        ...

    @property
    def problem(self) -> str:
        """The reason why there is no connection; '' while there is one."""
        ...

    def take(self) -> Sequence[LinkNews]:
        """Return the news since the last call, in order of arrival."""
        ...

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds` for news; return whether any has arrived."""
        ...

    def close(self) -> None:
        """End the connection; no member is called afterwards."""
        ...


class Link(Listener, Protocol):
    """A connection over which assets are commanded.

    A command id is carried out at most once; if it is sent again, its last answer is repeated. A
    hold is carried out each time. While there is no connection, commands are dropped, not queued.
    The answers are `acknowledged` or `refused`, then `done` or `failed`; a hold is `done` once the
    asset reports that it has stopped.
    """

    def send(self, command: DeviceCommand) -> None:
        """Send `command` to its asset; returns at once and never raises."""
        ...


@runtime_checkable
class Discovering(Listener, Protocol):
    """A link that can find robots that are not assets of the world."""

    def discover(self) -> Sequence[FoundRobot]:
        """Return every robot found on the link so far, including the assets of the world."""
        ...


@dataclass(frozen=True)
class LinkFinding:
    """One observation of a robot, such as a message that it sends or a parameter."""

    agent: str
    what: str
    found: str
    wanted: str = ""
    """The correct value; '' if the value found is correct."""
    consequence: str = ""
    """The effect of a wrong value; '' if the value found is correct."""

    def unless(self, good: object, wanted: str, consequence: str) -> "LinkFinding":
        """Return this finding; if it is not `good`, with the correct value and the consequence."""
        return self if good else replace(self, wanted=wanted, consequence=consequence)


@runtime_checkable
class Examined(Listener, Protocol):
    """A link that can report what its robots send and how they are configured."""

    def examine(self, seconds: float) -> Sequence[LinkFinding]:
        """Examine every robot, for `seconds` at most, without sending it a command."""
        ...


OpenLink = Callable[[str, World, Settings], Link]
"""The function of an entry point, which returns the link to an ADDRESS for the assets of a world.

It raises ValueError with a remedy if it cannot use the address or gets no answer there.
"""


@cache
def link_schemes() -> dict[str, EntryPoint]:
    """Return the entry point of each scheme; a package cannot replace one of the console's own."""
    return {point.name: point for point in (*entry_points(group=GROUP), *OWN)}


def open_link(url: str, world: World, settings: Settings) -> Link:
    """Return the link at `url`, in the form SCHEME:ADDRESS, for the assets of `world`.

    Raises ValueError with a remedy if the scheme is unknown, if a library is missing, or if the
    package of the link reports a problem.
    """
    scheme, _, address = url.partition(":")
    point = link_schemes().get(scheme)
    if point is None:
        schemes = ", ".join(
            [f"{bus}://HOST/SITE" for bus in BUS] + [f"{s}:..." for s in link_schemes()]
        )
        raise ValueError(
            f"--fleet {url}: there is no link {scheme!r}; give one of {schemes}, or install the "
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
