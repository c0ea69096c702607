"""Follows the ordering rules through a mission, moment by moment, live and in rehearsal (WF-01)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

from pa_console.policy.findings import finding, undecided, violation
from pa_console.policy.ordering import START, Progress, follow, leave
from pa_console.policy.rulebook import CompiledOrdering, CompiledRule, Rulebook
from pa_console.policy.subjects import Evaluator, Subject, Subjects, subjects
from pa_console.schema.finding import Finding
from pa_console.schema.moment import Moment
from pa_console.schema.rule import Rule
from pa_console.schema.world import World


class Pending(NamedTuple):
    """Something that must happen still; `due_s` is the simulated time until which, if limited."""

    rule_id: str
    subject: str
    message: str
    due_s: float | None


class Breach(NamedTuple):
    """An ordering of a rule that subjects broke, or that could not be decided (`problem`)."""

    rule: Rule
    message: str
    offenders: tuple[str, ...] = ()
    problem: str = ""


@dataclass
class _Watch:
    """One ordering: where each of its subjects stands, and how they looked at the last moment."""

    rule: Rule
    entry: CompiledOrdering
    limit_s: float
    problem: str = ""
    progress: dict[str, Progress] = field(default_factory=dict[str, Progress])
    last: Subjects = field(default_factory=dict[str, Subject])

    def copy(self) -> "_Watch":
        return replace(self, progress=dict(self.progress))

    def observe(self, now: Moment, present: Subjects, evaluator: Evaluator) -> Breach | None:
        """Move every subject on; return what is newly wrong."""
        if self.problem:
            return Breach(self.rule, self.entry.order.message, problem=self.problem)
        try:
            offenders = tuple(self._offenders(now, present, evaluator))
        except Exception as error:  # whatever CEL runs into: nothing is decided
            problem = f"{type(error).__name__}: {error}"
            return Breach(self.rule, self.entry.order.message, problem=problem)
        return Breach(self.rule, self.entry.order.message, offenders) if offenders else None

    def _offenders(self, now: Moment, present: Subjects, evaluator: Evaluator) -> Iterator[str]:
        """Yield the subjects that break the ordering now; '' stands for the moment as a whole."""
        order, entry = self.entry.order, self.entry
        unchanged = entry.fixed and present == self.last
        running = [name for name, was in self.progress.items() if was.stage == "open"]
        gone = [] if unchanged else [name for name in self.last if name not in present]
        for name in gone:
            was = self.progress.get(name, START)
            self.progress[name], broken = leave(order, was, now.time_s, self.limit_s)
            if broken:
                yield name
        for name in running if unchanged else present:
            if name not in present:
                continue
            event = evaluator.holds(entry.event, now, name, present[name])
            other = evaluator.holds(entry.other, now, name, present[name])
            was = self.progress.get(name, START)
            self.progress[name], broken = follow(
                order,
                was,
                event=event,
                other=other,
                time_s=now.time_s,
                limit_s=self.limit_s,
            )
            if broken:
                yield name
        self.last = present

    def pending(self) -> Iterator[Pending]:
        order = self.entry.order
        for name, was in self.progress.items():
            if was.stage == "open":
                due_s = was.since_s + self.limit_s if order.kind == "within" else None
                yield Pending(self.rule.id, name, order.message, due_s)

    def excuse_running_limits(self) -> None:
        """Take every time limit that runs as told already, until what began it has ended."""
        if self.entry.order.kind == "within":
            for name, was in self.progress.items():
                if was.stage == "open":
                    self.progress[name] = Progress("broken")


class Monitor:
    """The orderings of every rule in force over one mission's moments.

    A subject that appears later starts afresh. What is wrong is told once, and again only when it
    has been right in between.
    """

    def __init__(self, rulebook: Rulebook, world: World) -> None:
        """Begin with no history."""
        self._evaluator = Evaluator(world)
        self._covered_before: set[str] = set()
        self._watches = [
            self._watch(entry, ordering) for entry in rulebook.compiled for ordering in entry.order
        ]

    def observe(self, moment: Moment) -> tuple[Finding, ...]:
        """Take in the next moment; return one finding for each rule that it newly breaks."""
        breaches: list[Breach] = []
        by_kind: dict[str | None, Subjects] = {}
        for watch in self._watches:
            each = watch.entry.order.each
            if each not in by_kind:
                by_kind[each] = subjects(watch.entry.order, moment, self._covered_before)
            breach = watch.observe(moment, by_kind[each], self._evaluator)
            if breach is not None:
                breaches.append(breach)
        self._covered_before |= {gate for gate, covered in moment.covered.items() if covered}
        return _findings(breaches)

    def finish(self) -> tuple[Finding, ...]:
        """Return a finding for each rule by which something still had to happen in the mission."""
        return _findings(
            Breach(watch.rule, watch.entry.order.message, tuple(p.subject for p in open_ones))
            for watch in self._watches
            if watch.entry.order.kind == "after" and (open_ones := tuple(watch.pending()))
        )

    @property
    def pending(self) -> tuple[Pending, ...]:
        """What must happen still, by any rule."""
        return tuple(pending for watch in self._watches for pending in watch.pending())

    def copy(self, *, running_limits: bool = True) -> Self:
        """Return a monitor that goes on from here by itself.

        Without `running_limits`, whoever goes on is not blamed for a time limit that was running
        already: a plan that restores a gate which an asset's failure has uncovered cannot undo the
        time that passed before it.
        """
        twin = object.__new__(type(self))
        twin._evaluator = self._evaluator
        twin._covered_before = set(self._covered_before)
        twin._watches = [watch.copy() for watch in self._watches]
        if not running_limits:
            for watch in twin._watches:
                watch.excuse_running_limits()
        return twin

    def _watch(self, entry: CompiledRule, ordering: CompiledOrdering) -> _Watch:
        seconds = ordering.order.seconds
        if ordering.seconds is None:
            limit_s = seconds if isinstance(seconds, float) else 0.0
            return _Watch(entry.rule, ordering, limit_s)
        try:
            return _Watch(entry.rule, ordering, self._evaluator.number(ordering.seconds))
        except Exception as error:  # whatever CEL runs into: nothing is decided
            return _Watch(entry.rule, ordering, 0.0, f"{type(error).__name__}: {error}")


def _findings(breaches: Iterable[Breach]) -> tuple[Finding, ...]:
    """Return one finding a rule, all that is wrong with it in one message."""
    by_rule: dict[str, list[Breach]] = {}
    for breach in breaches:
        by_rule.setdefault(breach.rule.id, []).append(breach)
    return tuple(_finding(found) for found in by_rule.values())


def _finding(found: list[Breach]) -> Finding:
    rule = found[0].rule
    problems = [breach.problem for breach in found if breach.problem]
    if problems:
        return undecided(rule, problems[0])
    words = dict.fromkeys(violation(breach.message, breach.offenders) for breach in found)
    return finding(rule, "violates", "; ".join(words))
