"""The geofence of a drone: it is uploaded from the world, read back, compared and monitored.

The drone must stay inside the perimeter and outside the restricted zones. A drone with a different
geofence may not start a flight.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from pa_console.fleets.mavlink.commands import GLOBAL, Autopilot, Cmd, MavItem, e7
from pa_console.schema.events.event import Level
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.sim.worlds.geography import Geography

SAME_E7 = 2
"""The largest difference between matching corners, in 10^-7 degrees (2 cm); autopilots round."""

ANSWER_S = 30.0
"""The longest wait for the result of a transfer, in seconds; then the transfer is tried again."""

RETRY_S = 3.0
"""The time before a failed transfer is tried again, in seconds."""

VERTICES = (Cmd.FENCE_INSIDE, Cmd.FENCE_OUTSIDE)


@dataclass(frozen=True)
class FenceArea:
    """An area of a geofence; the drone must stay in it if `inside` is True, else outside of it.

    Corners are latitude and longitude, in degrees times 10^7.
    """

    name: str
    inside: bool
    corners: tuple[tuple[int, int], ...]

    @property
    def items(self) -> tuple[MavItem, ...]:
        """The area as items of a geofence."""
        command = Cmd.FENCE_INSIDE if self.inside else Cmd.FENCE_OUTSIDE
        params = (float(len(self.corners)), 0.0, 0.0, 0.0)
        return tuple(MavItem(command, x, y, 0.0, params, GLOBAL) for x, y in self.corners)


def fence_of(world: World, geography: Geography) -> tuple[FenceArea, ...]:
    """Return the geofence of a world, which is its perimeter and its restricted zones."""
    areas = [("the perimeter", True, world.perimeter)]
    areas += [(f"zone {name}", False, zone.polygon) for name, zone in world.zones.items()]
    return tuple(
        FenceArea(name, inside, tuple((e7(a), e7(b)) for a, b in map(geography.degrees, corners)))
        for name, inside, corners in areas
    )


def difference(areas: Sequence[FenceArea], items: Sequence[MavItem], geography: Geography) -> str:
    """Return the first difference of a geofence from `areas`; '' if there is none."""
    if not items:
        return "it has none"
    strange = next((item for item in items if item.command not in VERTICES), None)
    if strange is not None:
        return f"it has an item of another kind (MAV_CMD {strange.command})"
    polygons = [
        polygon
        for (_, corners), group in groupby(items, lambda item: (item.command, item.params[0]))
        for polygon in _split(list(group), round(corners))
    ]
    for area, polygon in zip(areas, polygons, strict=False):
        if (polygon[0].command == Cmd.FENCE_INSIDE) is not area.inside:
            return f"{area.name} is an area to stay {'out of' if area.inside else 'in'}"
        if len(polygon) != len(area.corners):
            return f"{area.name} has {count(len(polygon), 'corner')}, not {len(area.corners)}"
        for number, (item, (x, y)) in enumerate(zip(polygon, area.corners, strict=True), 1):
            if abs(item.x - x) > SAME_E7 or abs(item.y - y) > SAME_E7:
                return (
                    f"corner {number} of {area.name} is at {_place(geography, item.x, item.y)}, "
                    f"not at {_place(geography, x, y)}"
                )
    if len(polygons) < len(areas):
        return f"{areas[len(polygons)].name} is missing"
    if len(polygons) > len(areas):
        return f"it has {count(len(polygons) - len(areas), 'area')} more than the world"
    return ""


def _split(items: list[MavItem], corners: int) -> list[list[MavItem]]:
    """Return `items` as polygons with the given number of corners; the last one may have fewer."""
    step = max(corners, 1)
    return [items[start : start + step] for start in range(0, len(items), step)]


def _place(geography: Geography, x: int, y: int) -> str:
    try:
        east, north = geography.metres(x / 1e7, y / 1e7)
    except ValueError:
        return f"{x / 1e7:.7f}, {y / 1e7:.7f}"
    return f"({east:.1f}, {north:.1f})"


class FenceWatch:
    """The monitor of one drone's geofence, which uploads the world's geofence at most once.

    Later changes by others are reported but not corrected. They may have a reason, and two stations
    that overwrite each other's geofence would leave the drone without one.
    """

    def __init__(
        self,
        areas: tuple[FenceArea, ...],
        geography: Geography,
        autopilot: Autopilot,
        say: Callable[[Level, str], None],
        every_s: float,
    ) -> None:
        """Report to the operator with `say`; read the geofence again every `every_s` seconds."""
        self._areas, self._geography, self._autopilot = areas, geography, autopilot
        self._say, self._every_s = say, every_s
        self._asked: Literal["", "read", "upload", "enforce"] = ""
        """The request that the drone has not answered yet; any other answer is ignored."""
        self._until_s = 0.0
        self._why_not_upload = ""
        self._next_s = 0.0
        self._uploaded = self._shown = False
        self.differs = False
        """True if the geofence was read and is not the world's."""
        self.problem = "its geofence has not been read yet"
        """The reason why the drone may not start a flight; '' if its geofence is the world's."""
        self.pending = True
        """True until the geofence has been compared for the first time since the drone started."""

    def start_again(self) -> None:
        """Read the geofence again after a restart of the drone, which may have lost it."""
        self._uploaded, self._asked, self._next_s = False, "", 0.0
        self._refuse("its geofence has not been read since it started", "info")
        self.pending = True

    def step(self, now_s: float, why_not_upload: str) -> None:
        """Read the geofence if a check is due; `why_not_upload` is a reason not to replace it."""
        self._why_not_upload = why_not_upload
        if self._asked:
            if now_s < self._until_s:
                return
            self._asked = ""
            self._refuse("it does not answer when its geofence is read", "alarm")
        if now_s >= self._next_s:
            self._next_s = now_s + self._every_s
            self._ask("read", now_s)
            self._autopilot.read_fence()

    def read(self, problem: str, items: Sequence[MavItem], now_s: float) -> None:
        """Process the geofence of the drone, or the reason why it could not be read."""
        if not self._answered("read"):
            return
        if problem:
            self._next_s = min(self._next_s, now_s + RETRY_S)
            self._refuse(f"its geofence cannot be read ({problem})", "alarm")
            return
        differs = difference(self._areas, items, self._geography)
        self.differs = bool(differs)
        if not differs:
            self._ask("enforce", now_s)
            self._autopilot.enforce_fence()
        elif self._uploaded:
            self._refuse(f"its geofence is not the world's: {differs}", "alarm")
        elif self._why_not_upload:
            self._next_s = min(self._next_s, now_s + RETRY_S)
            self._refuse(f"it has no geofence of this world: {self._why_not_upload}", "alarm")
        else:
            self._ask("upload", now_s)
            self._autopilot.upload_fence([item for area in self._areas for item in area.items])

    def uploaded(self, problem: str, now_s: float) -> None:
        """Process the result of an upload; an accepted geofence is read back."""
        if not self._answered("upload"):
            return
        if problem:
            self._next_s = min(self._next_s, now_s + RETRY_S)
            self._refuse(f"it does not accept the geofence ({problem})", "alarm")
            return
        self._uploaded = True
        self._ask("read", now_s)
        self._autopilot.read_fence()

    def enforced(self, problem: str) -> None:
        """Record whether the drone enforces its geofence, which equals the world's.

        `problem` is the reason if it does not.
        """
        if not self._answered("enforce"):
            return
        if problem:
            self._refuse(f"it would not act on its geofence: {problem}", "alarm")
            return
        self._uploaded, self.pending = True, False
        if self.problem or not self._shown:
            self.problem, self._shown = "", True
            first, *zones = self._areas
            self._say(
                "info",
                f"its geofence was read back and is the world's: {first.name} of "
                f"{count(len(first.corners), 'corner')}, {count(len(zones), 'closed zone')}",
            )

    def _ask(self, request: Literal["read", "upload", "enforce"], now_s: float) -> None:
        self._asked, self._until_s = request, now_s + ANSWER_S

    def _answered(self, request: str) -> bool:
        """Return whether `request` was made, and mark it as answered."""
        if self._asked != request:
            return False
        self._asked = ""
        return True

    def _refuse(self, problem: str, level: Level) -> None:
        self.pending = False
        if problem != self.problem:
            self.problem = problem
            self._say(level, f"{problem}: it may not start a flight")
