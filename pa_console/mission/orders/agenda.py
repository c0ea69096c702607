"""The moments at which timed orders start missions, and the later return of their assets.

Every moment of an order is processed once, in turn. It starts a mission, or yields a reason why
none starts. If the clock is set back, no moment is repeated. After a jump of the clock, or a sleep
of the machine, a mission starts late only within the grace period, and an event reports the delay.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from pa_console.language.clock_words import duration_words
from pa_console.language.orders.patrols import USUAL, PatrolLimits
from pa_console.language.orders.timed_orders import SHORTEST_S
from pa_console.language.references.scene import Move
from pa_console.schema.command import STILL
from pa_console.schema.mission import StandingOrder

PAUSED = "it is paused"
STOPPED = "everything is stopped"


@dataclass(frozen=True)
class TimingLimits:
    """The limits of timed orders and patrols.

    `grace_s` is the longest delay with which a mission may start, and `shortest_s` the shortest
    interval between two moments, both in seconds.
    """

    grace_s: float = 60.0
    shortest_s: float = SHORTEST_S
    patrols: PatrolLimits = USUAL


def _wall() -> datetime:
    return datetime.now().astimezone()


class StationTime:
    """The station's clock for timed orders.

    It is the wall clock in the machine's time zone. If a simulation runs faster than real time, the
    clock moves ahead by the time gained. If a simulation advances only on request, the clock
    follows the simulated seconds alone.
    """

    def __init__(self, wall: Callable[[], datetime] = _wall) -> None:
        self._wall = wall
        self._first: tuple[datetime, float] | None = None
        self._last = wall(), 0.0
        self._ahead = timedelta()
        self.now = self._last[0]
        """The present time."""

    def take(self, time_s: float, rate: float = 1.0, *, stepped: bool = False) -> None:
        """Record the fleet's time, which advances by `rate` seconds per second.

        A `stepped` fleet advances only while a caller waits for it.
        """
        wall = self._wall()
        if self._first is None:
            self._first, self._last = (wall, time_s), (wall, time_s)
        if stepped:
            began, began_s = self._first
            self.now = began + timedelta(seconds=time_s - began_s)
            return
        before, before_s = self._last
        if rate > 1.0:
            # At a rate of 1, a simulation that was delayed only catches up, so it gains no time.
            gained = timedelta(seconds=time_s - before_s) - (wall - before)
            self._ahead += max(gained, timedelta())
        self._last = wall, time_s
        self.now = wall + self._ahead


@dataclass(frozen=True)
class MomentResult:
    """The result of a moment: the order to start and its delay, or why no mission starts."""

    order: str = ""
    late_s: float = 0.0
    reason: str = ""


@dataclass
class Agenda:
    """The moments at which a standing order in force starts missions, given by its schedule."""

    order: StandingOrder
    paused: bool = False
    _number: int = 0
    """The number of moments that have been processed."""
    _back_at: datetime | None = None
    _back: str = ""
    _open: set[str] = field(default_factory=set[str])
    """The order's missions that are not over."""
    _returned: bool = False
    """True once the return of the assets that the order sent has been decided."""
    _starting: bool = False
    """True from a moment that starts a mission until that mission is recorded."""

    @property
    def next(self) -> datetime | None:
        """The next moment at which a mission starts; None if no moment is left."""
        schedule = self.order.schedule
        moment = schedule.moment(self._number) if schedule is not None else None
        both = [at for at in (moment, self._back_at) if at is not None]
        return min(both, default=None)

    @property
    def over(self) -> bool:
        """True if the order has no moment left and no mission under way."""
        return self.next is None and not self._open and not self._starting

    def begin(self, now: datetime) -> None:
        """Set the first moment to `now`, the time of approval, if the order is to begin at once."""
        schedule = self.order.schedule
        if schedule is not None and schedule.at_once:
            begins = schedule.model_copy(update={"start": now})
            self.order = self.order.model_copy(update={"schedule": begins})

    def too_late(self, now: datetime, grace_s: float) -> bool:
        """Return whether it is too late for every moment of the order."""
        schedule, number = self.order.schedule, self._number
        if schedule is None or schedule.at_once:
            return False
        if schedule.every_s:
            number = max(int((now - schedule.start).total_seconds() // schedule.every_s), 0)
        at = schedule.moment(number) or schedule.moment(max(number - 1, 0))
        return at is None or at < now - timedelta(seconds=grace_s)

    def skip(self) -> datetime:
        """Skip the next moment and return it; raises ValueError if it cannot be skipped."""
        at = self.next
        if at is None:
            raise ValueError(f"{self.order.id} has no moment left to skip")
        if at == self._back_at:
            raise ValueError(f"{self.order.id} only waits to bring back whom it has sent")
        self._number += 1
        return at

    def look(self, now: datetime, grace_s: float, *, stopped: bool) -> Iterable[MomentResult]:
        """Process every moment that is due, and yield its result."""
        if self._back_at is not None and now >= self._back_at:
            at, order = self._back_at, self._back
            self._back_at, self._back = None, ""
            yield self._taken([at], now, grace_s, order, stopped=stopped)
        schedule, come = self.order.schedule, list[datetime]()
        if schedule is None:
            return
        while (at := schedule.moment(self._number)) is not None and at <= now:
            come.append(at)
            self._number += 1
        if len(come) > 1:
            passed = f"{len(come) - 1} moments from {come[0]:%H:%M:%S} to {come[-2]:%H:%M:%S}"
            yield MomentResult(
                reason=f"{passed} passed unseen: the clock jumped, or the machine slept"
            )
        if come:
            yield self._taken(come, now, grace_s, self.order.order, stopped=stopped)

    def _taken(
        self, come: Sequence[datetime], now: datetime, grace_s: float, order: str, *, stopped: bool
    ) -> MomentResult:
        at = come[-1]
        late_s = (now - at).total_seconds()
        if stopped:
            return MomentResult(reason=f"{at:%H:%M:%S}: {STOPPED}")
        if self.paused:
            return MomentResult(reason=f"{at:%H:%M:%S}: {PAUSED}")
        if late_s > grace_s:
            late, most = duration_words(late_s), duration_words(grace_s)
            return MomentResult(reason=f"{at:%H:%M:%S} passed {late} ago, {most} late is allowed")
        if self._open or self._starting:
            return MomentResult(
                reason=f"{at:%H:%M:%S}: {', '.join(sorted(self._open))} is not over"
            )
        self._starting = True
        return MomentResult(order, late_s)

    def started(self, mission: str) -> None:
        """Record the mission that the last moment started."""
        self._open.add(mission)
        self._starting = False

    def ended(self, mission: str, moves: Sequence[Move], base: str, now: datetime) -> str:
        """Record the end of a mission and its `moves`; return why no asset will return, or ''."""
        self._open.discard(mission)
        schedule = self.order.schedule
        if schedule is None or not schedule.stays or self._back_at is not None or self._returned:
            return ""
        self._returned = True
        self._back = way_back(moves, base, to_base=schedule.to_base)
        if not self._back:
            return "nobody was sent anywhere, so nobody goes back"
        self._back_at = schedule.leave or now + timedelta(seconds=schedule.stay_s)
        return ""


def way_back(moves: Sequence[Move], base: str, *, to_base: bool = False) -> str:
    """Return the order that sends moved assets back to their previous places or to the base.

    Returns '' if no asset has moved.
    """
    homes: dict[str, list[str]] = {}
    for agent, before in {move.agent: move.before for move in reversed(moves)}.items():
        went = {move.target for move in moves if move.agent == agent and move.verb not in STILL}
        if went - {before, ""}:
            homes.setdefault(base if to_base else before or base, []).append(agent)
    return " ".join(
        f"Send {' and '.join(sorted(names))} back to {'base' if place == base else place}."
        for place, names in sorted(homes.items())
    )
