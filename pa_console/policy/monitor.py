"""Monitoring of ordering rules, moment by moment, in live missions and rehearsals (WF-01)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, Self

from pa_console.policy.expressions.deadlines import shared_deadline
from pa_console.policy.findings import finding, undecided, violation
from pa_console.policy.moments import Pursuits
from pa_console.policy.orderings import (
    START,
    Evaluator,
    OrderingProgress,
    Subjects,
    follow,
    leave,
    subjects,
)
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import CompiledOrdering, CompiledRule, Rulebook
from pa_console.schema.finding import Finding
from pa_console.schema.rehearsal import Moment
from pa_console.schema.rule import PRIORITIES, Rule
from pa_console.schema.world import World

Each = Literal["track", "gate"] | None

MOMENT_S = 0.02
SUBJECT_S = 0.002
"""The processor time that each subject adds to the limit for one moment, in seconds."""


class Pending(NamedTuple):
    """An event that must still happen; `due_s` is its deadline in simulated seconds, if any."""

    rule_id: str
    subject: str
    message: str
    due_s: float | None


class OrderingBreach(NamedTuple):
    """A broken ordering and the subjects that broke it; with a `problem`, it is undecided."""

    rule: Rule
    message: str
    offenders: tuple[str, ...] = ()
    problem: str = ""


class _News(NamedTuple):
    """The subjects of one kind at a moment, and which of them have changed or gone."""

    present: Subjects
    changed: tuple[str, ...]
    gone: tuple[str, ...]

    @classmethod
    def since(cls, last: Subjects, present: Subjects) -> Self:
        """Compare the subjects with those of the previous moment."""
        changed = (name for name, it in present.items() if name not in last or last[name] != it)
        return cls(present, tuple(changed), tuple(name for name in last if name not in present))


@dataclass
class _OrderingWatch:
    """One ordering and the progress of each of its subjects."""

    rule: Rule
    entry: CompiledOrdering
    limit_s: float
    problem: str = ""
    progress: dict[str, OrderingProgress] = field(default_factory=dict[str, OrderingProgress])
    failed: bool = False

    def copy(self) -> "_OrderingWatch":
        return replace(self, progress=dict(self.progress))

    def observe(self, now: Moment, news: _News, evaluator: Evaluator) -> OrderingBreach | None:
        """Update every subject; return the new breach, or None."""
        message, problem, offenders = self.entry.order.message, self.problem, ()
        if not problem:
            try:
                offenders = tuple(self._offenders(now, news, evaluator))
                self.failed = False
            except Exception as error:  # whatever CEL raises: nothing is decided
                problem, self.failed = f"{type(error).__name__}: {error}", True
        if not problem and not offenders:
            return None
        return OrderingBreach(self.rule, message, offenders, problem)

    def _offenders(self, now: Moment, news: _News, evaluator: Evaluator) -> Iterator[str]:
        """Yield the subjects that break the ordering now; '' is the moment as a whole."""
        order, entry = self.entry.order, self.entry
        for name in news.gone:
            was = self.progress.get(name, START)
            self.progress[name], broken = leave(order, was, now.time_s, self.limit_s)
            if broken:
                yield name
        for name in self._to_follow(news):
            subject = news.present[name]
            self.progress[name], broken = follow(
                order,
                self.progress.get(name, START),
                event=evaluator.holds(entry.event, now, name, subject),
                other=evaluator.holds(entry.other, now, name, subject),
                time_s=now.time_s,
                limit_s=self.limit_s,
            )
            if broken:
                yield name

    def _to_follow(self, news: _News) -> Iterable[str]:
        """Return the subjects whose progress this moment may change."""
        if self.failed or not self.entry.fixed:
            return tuple(news.present)
        if self.entry.order.kind != "within":
            return news.changed
        running = (name for name, was in self.progress.items() if was.stage == "open")
        return dict.fromkeys((*news.changed, *(name for name in running if name in news.present)))

    def pending(self) -> Iterator[Pending]:
        order = self.entry.order
        for name, was in self.progress.items():
            if was.stage == "open":
                due_s = was.since_s + self.limit_s if order.kind == "within" else None
                yield Pending(self.rule.id, name, order.message, due_s)

    def excuse_running_limits(self) -> None:
        """Mark every running time limit as already reported, until its cause has ended."""
        if self.entry.order.kind == "within":
            for name, was in self.progress.items():
                if was.stage == "open":
                    self.progress[name] = OrderingProgress("broken")


class Monitor:
    """The orderings of every rule in force, followed over the moments of one mission.

    A subject that appears later starts from the beginning. A violation is reported once; it is
    reported again only if it was resolved in between.
    """

    def __init__(
        self,
        rulebook: Rulebook,
        world: World,
        sightings: Sightings | None = None,
        pursuits: Pursuits | None = None,
    ) -> None:
        """Begin without a history of the mission; the receiver of telemetry updates `sightings`.

        `pursuits` are the pursuits of the session; without them, the mission begins with none.
        """
        self.sightings = Sightings(world) if sightings is None else sightings
        """The earlier sightings. Only checks need them; orderings do not."""
        self._pursuits = Pursuits() if pursuits is None else pursuits
        self._evaluator = Evaluator(world)
        self._covered_before: set[str] = set()
        self._last: dict[Each, Subjects] = {}
        orderings = [(part, ordering) for part in rulebook.parts for ordering in part.order]
        for _, ordering in orderings:
            self._evaluator.prepare(ordering.order, ordering.event, ordering.other)
        with shared_deadline(MOMENT_S):
            self._watches = [self._watch(part, ordering) for part, ordering in orderings]

    def observe(self, moment: Moment) -> tuple[Finding, ...]:
        """Update from the next moment; return one finding for each rule that is newly broken."""
        moment = self._pursuits.look(moment)
        news: dict[Each, _News] = {}
        breaches: list[OrderingBreach] = []
        subjects_now = len(moment.tracks) + len(moment.covered)
        with shared_deadline(MOMENT_S + SUBJECT_S * subjects_now):
            for watch in self._watches:
                each = watch.entry.order.each
                if each not in news:
                    present = subjects(watch.entry.order, moment, self._covered_before)
                    news[each] = _News.since(self._last.get(each, {}), present)
                breach = watch.observe(moment, news[each], self._evaluator)
                if breach is not None:
                    breaches.append(breach)
        self._last = {each: new.present for each, new in news.items()}
        self._covered_before |= {gate for gate, covered in moment.covered.items() if covered}
        return _findings(breaches)

    def finish(self) -> tuple[Finding, ...]:
        """Return a finding for each rule with an event that should still have happened."""
        return _findings(
            OrderingBreach(
                watch.rule, watch.entry.order.message, tuple(p.subject for p in open_ones)
            )
            for watch in self._watches
            if watch.entry.order.kind == "after" and (open_ones := tuple(watch.pending()))
        )

    @property
    def pending(self) -> tuple[Pending, ...]:
        """The events that must still happen, of all rules."""
        return tuple(pending for watch in self._watches for pending in watch.pending())

    def copy(self, *, running_limits: bool = True) -> Self:
        """Return an independent monitor that continues from here.

        Without `running_limits`, time limits that are already running are excused: a plan that
        restores a gate after an asset's failure cannot undo the time that has passed.
        """
        twin = object.__new__(type(self))
        twin.sightings, twin._evaluator = self.sightings, self._evaluator.copy()
        twin._pursuits = self._pursuits.copy()
        twin._covered_before = set(self._covered_before)
        twin._last = self._last
        twin._watches = [watch.copy() for watch in self._watches]
        if not running_limits:
            for watch in twin._watches:
                watch.excuse_running_limits()
        return twin

    def _watch(self, entry: CompiledRule, ordering: CompiledOrdering) -> _OrderingWatch:
        seconds = ordering.order.seconds
        if ordering.seconds is None:
            limit_s = seconds if isinstance(seconds, float) else 0.0
            return _OrderingWatch(entry.rule, ordering, limit_s)
        try:
            return _OrderingWatch(entry.rule, ordering, self._evaluator.number(ordering.seconds))
        except Exception as error:  # whatever CEL raises: nothing is decided
            return _OrderingWatch(entry.rule, ordering, 0.0, f"{type(error).__name__}: {error}")


def halts(finding: Finding, rulebook: Rulebook) -> bool:
    """Return whether the finding of a broken ordering halts the plan.

    Orderings about gates do not halt it, because premises and alarms deal with gates.
    """
    orderings = rulebook.orderings(finding.rule_id)
    return finding.blocking and any(ordering.each != "gate" for ordering in orderings)


def _findings(breaches: Iterable[OrderingBreach]) -> tuple[Finding, ...]:
    """Return one finding per rule, with all its breaches in one message."""
    by_rule: dict[str, list[OrderingBreach]] = {}
    for breach in breaches:
        by_rule.setdefault(breach.rule.id, []).append(breach)
    return tuple(_finding(of_rule) for of_rule in by_rule.values())


def _finding(breaches: list[OrderingBreach]) -> Finding:
    rule = min((breach.rule for breach in breaches), key=lambda r: PRIORITIES.index(r.priority))
    problems = [breach.problem for breach in breaches if breach.problem]
    if problems:
        return undecided(rule, problems[0])
    words = dict.fromkeys(violation(breach.message, breach.offenders) for breach in breaches)
    return finding(rule, "violates", "; ".join(words))
