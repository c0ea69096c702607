"""The standing orders in force, and the missions that they start.

An order waits for a state of the picture, or for a moment of the clock (`agenda`). An order that
waits for a state starts one mission for each occurrence. An occurrence begins when the order's
condition begins to hold for a subject, and counts once it has held for SETTLE_S. It is over once
the condition has not held for REST_S; only then can the same subject have another occurrence.

If the mission fails, the order starts another one RETRY_S after its end. An occurrence waits while
another mission deals with its subject, and while the order has reached its limit of starts per
hour. No mission is started for a change that a standing order's own mission has caused, or while
everything is stopped. All times except moments are simulated seconds. Conditions are evaluated on
the picture alone.
"""

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Literal

from pa_console.language.references.scene import Move
from pa_console.mission.orders.agenda import Agenda, StationTime, TimingLimits
from pa_console.policy.standing_conditions import StandingCondition
from pa_console.schema.events.intake import StandingOrderScheduled
from pa_console.schema.mission import PLACE, StandingOrder, StandingStart
from pa_console.schema.telemetry import Picture
from pa_console.schema.text import count

SETTLE_S = 1.0
"""The time that a condition must hold, in seconds; a shorter change is noise."""
REST_S = 30.0
"""The time without its condition after which an occurrence is over, in seconds."""
RETRY_S = 300.0
"""The time from the end of a mission that failed until its order tries again, in seconds."""
HOUR_S = 3600.0
AGAIN_S = 2.0
"""The error of the countdown to a moment at which that moment is emitted again, in seconds."""
MOST_ORDERS = 20
"""The largest number of standing orders in force."""


@dataclass(frozen=True)
class Due:
    """A mission that an order in force starts now."""

    order: StandingOrder
    start: StandingStart
    subject: str = ""
    gate: str | None = None
    late_s: float = 0.0


@dataclass(frozen=True)
class Withheld:
    """An occurrence or moment for which no mission starts, and the reason."""

    order: StandingOrder
    subject: str
    reason: str


@dataclass(frozen=True)
class Ended:
    """An order that is no longer in force, because it can start nothing more."""

    order: StandingOrder


StandingResult = Due | Withheld | Ended | StandingOrderScheduled
"""A result of `StandingOrders.look`, on which the station acts and which it emits."""


@dataclass
class _Occurrence:
    """An occurrence: the times at which its condition began to hold and was last seen to hold."""

    since_s: float
    seen_s: float
    handled: bool = False
    """True if a mission has been started, or none will be."""
    effect_of: str = ""
    """The standing order's mission that caused the occurrence; '' if none did."""
    withheld: str = ""
    """The last reason why its mission has to wait; '' if it need not wait."""
    mission: str = ""
    """The last mission that was started for it; '' if none was."""
    not_before_s: float = 0.0
    """The earliest time of its next mission."""


@dataclass(frozen=True)
class StandingBan:
    """A standing order that starts nothing, but bans movements from plans."""

    order: StandingOrder


Trigger = StandingCondition | Agenda | StandingBan


@dataclass
class _InForce:
    """An approved order, its trigger, and the times when it started missions."""

    trigger: Trigger
    paused: bool = False
    emitted: StandingOrderScheduled | None = None
    """The last event with its next moment; None before the first."""
    occurrences: dict[str, _Occurrence] = field(default_factory=dict[str, _Occurrence])
    starts_s: deque[float] = field(default_factory=deque[float])
    problem: str = ""
    """The error of the last evaluation of its condition; '' if there was none."""

    @property
    def order(self) -> StandingOrder:
        return self.trigger.order


@dataclass
class _Own:
    """A mission started by a standing order, with the assets and places of its moves."""

    order: str
    subject: str
    moved: frozenset[str] = frozenset()
    moves: tuple[Move, ...] = ()
    ended_s: float | None = None


class StandingOrders:
    """The standing orders in force in one session, each approved by an operator."""

    def __init__(self, time: StationTime | None = None) -> None:
        self.time, self.limits = time or StationTime(), TimingLimits()
        self._in_force: dict[str, _InForce] = {}
        self._own: dict[str, _Own] = {}
        self._count = 0

    # The orders in force

    def new_id(self) -> str:
        """Return the id for a new standing order."""
        self._count += 1
        return f"S{self._count}"

    def skip_ids(self, used: Iterable[str]) -> None:
        """Avoid ids that were used earlier in the session for new orders."""
        self._count = max([self._count, *(int(name.removeprefix("S")) for name in used)])

    @property
    def orders(self) -> tuple[StandingOrder, ...]:
        """The orders in force, the oldest first."""
        return tuple(entry.order for entry in self._in_force.values())

    def find(self, order_id: str) -> StandingOrder | None:
        """Return the order in force with the id `order_id`; None if there is none."""
        entry = self._in_force.get(order_id)
        return entry.order if entry is not None else None

    def banned_by(self, agent: str, goal: str) -> StandingOrder | None:
        """Return an order in force that bans sending `agent` to `goal`; None if no order does."""
        for entry in self._in_force.values():
            ban = entry.order.ban
            if ban is not None and not entry.paused and ban.forbids(agent, goal or None):
                return entry.order
        return None

    def refusal(self, order: StandingOrder) -> str:
        """Return why `order` cannot come into force beside the others; '' if it can."""
        if Agenda(order).too_late(self.time.now, self.limits.grace_s):
            return f"its moment, {order.words}, has passed: it is {self.time.now:%H:%M:%S}"
        if len(self._in_force) >= MOST_ORDERS:
            return f"{MOST_ORDERS} standing orders are in force: revoke one first"
        same = (
            order_in_force.id
            for order_in_force in self.orders
            if _content(order_in_force) == _content(order)
        )
        return f"{existing} says the same and is in force" if (existing := next(same, "")) else ""

    def approve(self, trigger: Trigger) -> StandingOrder:
        """Put an approved order in force and return it; raises ValueError if that is impossible."""
        order = trigger.order
        if problem := self.refusal(order):
            raise ValueError(problem)
        if order.id in self._in_force:
            raise ValueError(f"{order.id} is in force already")
        if isinstance(trigger, Agenda):
            trigger.begin(self.time.now)
        self._in_force[order.id] = _InForce(trigger)
        return trigger.order

    def revoke(self, order_id: str) -> StandingOrder:
        """Revoke a standing order and return it; raises ValueError if it is not in force."""
        self._entry(order_id)
        return self._in_force.pop(order_id).order

    def pause(self, order_id: str, *, paused: bool) -> None:
        """Pause or resume an order; raises ValueError if that changes nothing."""
        entry = self._entry(order_id)
        if entry.paused == paused:
            raise ValueError(f"{order_id} {'is paused already' if paused else 'is not paused'}")
        entry.paused = paused
        if isinstance(entry.trigger, Agenda):
            entry.trigger.paused = paused

    def skip(self, order_id: str) -> datetime:
        """Skip the next moment of an order and return it; raises ValueError if it has none."""
        entry = self._entry(order_id)
        if not isinstance(entry.trigger, Agenda):
            raise ValueError(f"{order_id} waits for a state, not for a moment: nothing to skip")
        return entry.trigger.skip()

    def scheduled(
        self, order_id: str, change: Literal["paused", "resumed", "skipped"], by: str, time_s: float
    ) -> StandingOrderScheduled:
        """Return the event for a `change` that `by` made to an order, with the next moment.

        `time_s` is the present time on the fleet's clock.
        """
        entry = self._entry(order_id)
        entry.emitted = self._following(entry, time_s)
        return entry.emitted.model_copy(update={"change": change, "by": by})

    def _entry(self, order_id: str) -> _InForce:
        if order_id not in self._in_force:
            in_force = ", ".join(self._in_force) or "none"
            raise ValueError(f"no standing order {order_id!r} is in force; in force: {in_force}")
        return self._in_force[order_id]

    # The missions that the orders start

    def look(
        self, picture: Picture, busy: Collection[str] = (), *, stopped: bool = False
    ) -> list[StandingResult]:
        """Process a new picture; return the missions to start, and why others are not started.

        Each mission that is returned counts as started. No mission starts for a subject in `busy`,
        because another mission about that subject waits or is under way. Occurrences that begin
        while everything is `stopped` count as handled, so they start no mission after the stop.
        """
        self._forget(picture.time_s)
        results: list[StandingResult] = []
        for entry in list(self._in_force.values()):
            if isinstance(entry.trigger, Agenda):
                results += self._keep(entry, entry.trigger, picture.time_s, stopped=stopped)
                continue
            if isinstance(entry.trigger, StandingBan):
                continue
            condition = entry.trigger
            taken = {*busy, *(result.subject for result in results if isinstance(result, Due))}
            try:
                holding = condition.holding(picture)
            except Exception as error:  # CEL failed, so nothing is decided
                results += self._undecided(entry, f"{type(error).__name__}: {error}")
                continue
            entry.problem = ""
            held_back = stopped or entry.paused
            results += self._watch(entry, holding, picture, taken, stopped=held_back)
        return results

    def _keep(
        self, entry: _InForce, agenda: Agenda, time_s: float, *, stopped: bool
    ) -> Iterator[StandingResult]:
        """Process the moments of an order that are due; yield its next moment if it has changed."""
        now = self.time.now
        for moment in agenda.look(now, self.limits.grace_s, stopped=stopped):
            if moment.reason:
                yield Withheld(entry.order, "", moment.reason)
            else:
                start = StandingStart(order=moment.order)
                yield Due(entry.order, start, late_s=moment.late_s)
        if agenda.over:
            del self._in_force[entry.order.id]
            yield Ended(entry.order)
            return
        following, emitted = self._following(entry, time_s), entry.emitted
        if (
            emitted is None
            or emitted.moment != following.moment
            or _apart(emitted.at_s, following.at_s)
        ):
            entry.emitted = following
            yield following

    def _following(self, entry: _InForce, time_s: float) -> StandingOrderScheduled:
        """Return the event with an order's next moment; None if the order waits for a state."""
        at = entry.trigger.next if isinstance(entry.trigger, Agenda) else None
        ahead_s = (at - self.time.now).total_seconds() if at is not None else 0.0
        return StandingOrderScheduled(
            order_id=entry.order.id,
            moment=at,
            at_s=max(time_s + ahead_s, 0.0) if at is not None else None,
            paused=entry.paused,
        )

    def started(self, mission: str, due: Due) -> None:
        """Record that `mission` was started for `due`."""
        self._own[mission] = _Own(due.order.id, due.subject)
        if (occurrence := self._occurrence(due.order.id, due.subject)) is not None:
            occurrence.mission = mission
        if (agenda := self._agenda(due.order.id)) is not None:
            agenda.started(mission)

    def starter(self, mission: str) -> str:
        """Return the id of the order that started `mission`; '' for none."""
        own = self._own.get(mission)
        return own.order if own is not None else ""

    def moves(self, mission: str, names: Collection[str], moves: Sequence[Move] = ()) -> None:
        """Record that `mission` affects `names`, so that changes of them count as its own effect.

        `names` are its assets and places; `moves` have the previous places of the assets.
        """
        own = self._own.get(mission)
        if own is not None:
            moved = own.moved | frozenset(filter(None, names))
            self._own[mission] = replace(own, moved=moved, moves=(*own.moves, *moves))

    def ended(
        self, mission: str, time_s: float, base: str = "", *, failed: bool = False
    ) -> tuple[StandingOrder, str] | None:
        """Record the end of `mission`; return its standing order and why no asset returns, or ''.

        If the mission has `failed` and its occurrence is not over after RETRY_S, the order starts
        another. Returns None if the mission was started by no order that is in force.
        """
        own = self._own.get(mission)
        if own is None or own.ended_s is not None:
            return None
        own.ended_s = time_s
        occurrence = self._occurrence(own.order, own.subject)
        if failed and occurrence is not None and occurrence.mission == mission:
            occurrence.handled, occurrence.not_before_s = False, time_s + RETRY_S
        order, agenda = self.find(own.order), self._agenda(own.order)
        remark = agenda.ended(mission, own.moves, base, self.time.now) if agenda is not None else ""
        return (order, remark) if order is not None else None

    def _occurrence(self, order_id: str, subject: str) -> _Occurrence | None:
        entry = self._in_force.get(order_id)
        return entry.occurrences.get(subject) if entry is not None else None

    def _agenda(self, order_id: str) -> Agenda | None:
        entry = self._in_force.get(order_id)
        return entry.trigger if entry is not None and isinstance(entry.trigger, Agenda) else None

    # The occurrences of one order

    def _watch(
        self,
        entry: _InForce,
        holding: Mapping[str, bool | None],
        picture: Picture,
        busy: Collection[str],
        *,
        stopped: bool,
    ) -> list[Due | Withheld]:
        now_s, results = picture.time_s, list[Due | Withheld]()
        for subject, holds in holding.items():
            occurrence = entry.occurrences.get(subject)
            if holds is None:
                if occurrence is not None:
                    occurrence.seen_s, occurrence.handled = now_s, occurrence.handled or stopped
                continue
            if holds and occurrence is None:
                occurrence = _Occurrence(now_s, now_s, effect_of=self._cause(subject))
                entry.occurrences[subject] = occurrence
            if holds and occurrence is not None:
                occurrence.seen_s = now_s
                occurrence.handled = occurrence.handled or stopped
                due_s = max(occurrence.since_s + SETTLE_S, occurrence.not_before_s)
                if not occurrence.handled and now_s >= due_s:
                    results += self._decide(entry, subject, occurrence, picture, busy)
        for subject, occurrence in list(entry.occurrences.items()):
            settled = occurrence.handled or occurrence.withheld or occurrence.mission
            over = now_s - occurrence.seen_s >= REST_S or not (settled or holding.get(subject))
            if over and occurrence.seen_s < now_s:
                del entry.occurrences[subject]
        return results

    def _decide(
        self,
        entry: _InForce,
        subject: str,
        occurrence: _Occurrence,
        picture: Picture,
        busy: Collection[str],
    ) -> Iterator[Due | Withheld]:
        """Yield the mission for an occurrence, or why there is none, unless that is known."""
        order = entry.order
        start = start_for(order, subject, picture)
        if occurrence.effect_of:
            occurrence.handled = True
            why = f"{occurrence.effect_of}, which a standing order started, has brought it about"
            yield Withheld(order, subject, why)
            return
        if reason := self._wait_reason(entry, subject, picture.time_s, busy):
            if reason != occurrence.withheld:
                occurrence.withheld = reason
                yield Withheld(order, subject, reason)
            return
        occurrence.handled, occurrence.withheld = True, ""
        if start is None:
            yield Withheld(order, subject, "its gate is not known")
        else:
            entry.starts_s.append(picture.time_s)
            yield Due(order, start, subject, _gate(order, subject, picture) or None)

    @staticmethod
    def _wait_reason(entry: _InForce, subject: str, now_s: float, busy: Collection[str]) -> str:
        """Return why a mission about `subject` has to wait; '' if it need not."""
        while entry.starts_s and now_s - entry.starts_s[0] >= HOUR_S:
            entry.starts_s.popleft()
        if subject in busy:
            return "waits for the end of another mission that deals with it"
        if len(entry.starts_s) >= entry.order.most_an_hour:
            started = count(len(entry.starts_s), "mission")
            return f"waits because the order has started {started} in an hour"
        return ""

    def _cause(self, subject: str) -> str:
        """Return a standing order's recent mission that affects `subject`; '' if there is none."""
        return next((name for name, own in self._own.items() if subject in own.moved), "")

    def _undecided(self, entry: _InForce, problem: str) -> Sequence[Withheld]:
        if entry.problem == problem:
            return ()
        entry.problem = problem
        return (Withheld(entry.order, "", f"its condition cannot be looked up: {problem}"),)

    def _forget(self, now_s: float) -> None:
        """Forget the missions that ended too long ago to cause a present change."""
        for name, own in list(self._own.items()):
            if own.ended_s is not None and now_s - own.ended_s >= REST_S:
                del self._own[name]


def start_for(order: StandingOrder, subject: str, picture: Picture) -> StandingStart | None:
    """Return the mission that `order` starts for `subject`; None if its gate is unknown."""
    place = _gate(order, subject, picture)
    if PLACE in order.order and not place:
        return None
    track = picture.tracks.get(subject) if order.each == "track" else None
    name = f"the {track.kind} at {track.gate}" if track is not None else subject
    return StandingStart(subject=subject, order=order.order_for(name, place))


def example_subject(order: StandingOrder, picture: Picture) -> tuple[str, str]:
    """Return an example subject of `order` and a gate, both as an order names them."""
    gate = next(iter(picture.gates), "")
    match order.each:
        case "gate":
            return gate, gate
        case "track":
            return f"the vehicle at {gate}", gate
        case "asset":
            return next(iter(picture.assets), ""), gate
        case None:
            return "", ""


def starts_now(condition: StandingCondition, picture: Picture) -> tuple[StandingStart, ...]:
    """Return the missions that an order would start at once if it were in force.

    Raises ValueError if its condition cannot be evaluated.
    """
    try:
        holding = condition.holding(picture)
    except Exception as error:
        raise ValueError(f"its condition cannot be looked up: {error}") from error
    starts = (start_for(condition.order, name, picture) for name, holds in holding.items() if holds)
    return tuple(start for start in starts if start is not None)


def _gate(order: StandingOrder, subject: str, picture: Picture) -> str:
    """Return the gate of a subject; '' if it has none."""
    if order.each == "gate":
        return subject
    if order.each == "track":
        return picture.tracks[subject].gate if subject in picture.tracks else ""
    asset = picture.assets.get(subject)
    place = (asset.post or asset.at or "") if asset is not None else ""
    return place if place in picture.gates else ""


def _apart(emitted_s: float | None, at_s: float | None) -> bool:
    """Return whether an emitted countdown has become wrong because the clock jumped."""
    return emitted_s is not None and at_s is not None and abs(emitted_s - at_s) >= AGAIN_S


def _content(order: StandingOrder) -> tuple[object, ...]:
    return order.condition or order.schedule or order.ban, order.each, order.order
