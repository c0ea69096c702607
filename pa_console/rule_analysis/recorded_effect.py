"""The changed decisions of a rule set in recorded sessions, before it is live."""

from collections.abc import Iterable

from pa_console.orchestrator.planning.approval import (
    CheckedPlan,
    OrderAsRead,
    inadmissible,
    request_approval,
)
from pa_console.policy.rulebook import Rulebook
from pa_console.rule_analysis.changed_decisions import (
    ChangedDecision,
    Findings,
    Gap,
    SessionEffect,
    blocking,
    by_rule,
    differ,
    in_words,
    orders_of,
    plan_flips,
    status_in_words,
)
from pa_console.rule_analysis.recheck import Again, Checked, Recheck, Running, Taken, Unrecorded
from pa_console.schema.events import event as ev
from pa_console.schema.world import World


def effect_on_session(
    events: Iterable[ev.Event], world: World, new: Rulebook, was: Rulebook | None = None
) -> SessionEffect:
    """Return the decisions of a recorded session that `new` rules change.

    The judge's verdicts, the operator's decisions and all later events stay as recorded. `was` are
    the rules of the session: a finding that even they do not reproduce is a gap, not a change;
    without them the broken orderings of a running plan are unknown. Raises the errors of reading
    `events`.
    """
    return _follow(events, Recheck(world, (new,), was), new, has_old=was is not None)


def decided_again(events: Iterable[ev.Event], world: World, own: Rulebook) -> SessionEffect:
    """Return the decisions of a recorded session that its own rules do not reproduce.

    `own` are the rules at its beginning; later rules are in its log. Raises the errors of reading
    `events`.
    """
    return _follow(events, Recheck(world, (), own), own, has_old=False)


def _follow(
    events: Iterable[ev.Event], again: Recheck, rules: Rulebook, *, has_old: bool
) -> SessionEffect:
    effect = _Session(again, rules, has_old)
    for event in events:
        effect.see(event)
    return effect.found


class _Session:
    """Comparison of recorded decisions with those of other rules, event by event."""

    def __init__(self, again: Recheck, new: Rulebook, has_old: bool) -> None:
        self.found = SessionEffect()
        self._again, self._new, self._has_old = again, new, has_old
        self._checked: dict[tuple[str, int], Findings] = {}
        self._halts: set[tuple[str, int, str]] = set()

    def see(self, event: ev.Event) -> None:
        for result in self._again.see(event):
            self._compare(result)
        data = event.data
        if isinstance(data, ev.SessionStarted):
            self.found.session = data.session
        elif isinstance(data, ev.DecisionMade) and event.mission:
            self._decided(event.mission, data)

    def _compare(self, result: Again) -> None:
        match result:
            case Taken(mission, recorded, found):
                self.found.missions += 1
                self._taken(mission.id, recorded, found)
            case Checked(mission, attempt, _, None, reason):
                self.found.gaps.append(Gap(mission.id, attempt, "", reason))
            case Checked(mission, attempt, recorded, found) if found is not None:
                self._plan(mission.id, attempt, recorded, found)
            case Running():
                self._running(result)
            case Unrecorded(mission, attempt, reason):
                self.found.gaps.append(Gap(mission.id, attempt, "", reason))
            case _:
                pass

    def _taken(self, mission: str, recorded: Findings, found: tuple[Findings, ...]) -> None:
        """Compare whether the mission is refused before any model is asked."""
        was, new = blocking(recorded), blocking(found[0])
        if self._has_old and bool(blocking(found[1])) != bool(was):
            reason = "whether it is refused comes out otherwise under the same rules"
            self.found.gaps.append(Gap(mission, 0, "", reason))
        elif bool(was) != bool(new):
            states = ("refused", "taken") if was else ("taken", "refused")
            why = tuple(finding.rule_id for finding in was or new)
            flip = ChangedDecision("intake", mission, 0, "", why, *states, in_words(was or new))
            self.found.flips.append(flip)

    def _plan(
        self, mission: str, attempt: int, recorded: Findings, found: tuple[Findings, ...]
    ) -> None:
        """Compare rule by rule, then whether the plan may be approved."""
        old, repeated = by_rule(recorded), by_rule(found[1] if self._has_old else recorded)
        self.found.plans += 1
        self.found.compared += len({*old, *by_rule(found[0])})
        doubtful = [
            rule
            for rule in dict.fromkeys((*old, *repeated))
            if differ(old.get(rule), repeated.get(rule))
        ]
        for rule in doubtful:
            was, now = status_in_words(old.get(rule)), status_in_words(repeated.get(rule))
            reason = f"recorded is {was!r}, but under the same rules it comes out as {now!r}"
            self.found.gaps.append(Gap(mission, attempt, rule, reason))
        self.found.flips += plan_flips(
            mission, attempt, self._orders(mission, attempt), recorded, found[0], doubtful
        )
        if not doubtful:
            self._checked[mission, attempt] = found[0]

    def _decided(self, mission: str, made: ev.DecisionMade) -> None:
        """Compare whether the operator's decision was admissible, the verdict as it was."""
        findings = self._checked.get((mission, made.attempt))
        started = self._again.state.started
        attempt = self._again.state.missions[mission].find(made.attempt)
        if findings is None or attempt is None or attempt.plan is None or started is None:
            return
        readings = (made.decision.asked,) if made.decision.kind == "choose" else ()
        request = request_approval(
            made.decision.request_id,
            made.attempt,
            CheckedPlan(
                attempt.plan,
                findings,
                attempt.verdict,
                attempt.judge_error or "it was not asked, as the plan was blocked",
            ),
            OrderAsRead(readings=readings),
            judging=started.variant.judging,
        )
        problem = inadmissible(request, made.decision)
        if bool(problem) != made.accepted:
            return
        old, new = by_rule(attempt.findings), by_rule(findings)
        why = tuple(r for r in dict.fromkeys((*old, *new)) if differ(old.get(r), new.get(r)))
        states = ("accepted", "refused") if made.accepted else ("refused", "accepted")
        was, now = (f"{made.decision.kind} {state}" for state in states)
        orders, words = orders_of(attempt.plan), problem or made.detail
        flip = ChangedDecision("decision", mission, made.attempt, orders, why, was, now, words)
        self.found.flips.append(flip)

    def _running(self, running: Running) -> None:
        """Compare which orderings halt the running plan with those of the rules it ran with."""
        if not self._has_old:
            return
        mission, attempt = running.mission.id, running.attempt
        new, was = (by_rule(blocking(findings)) for findings in running.found)
        for rule in dict.fromkeys((*was, *new)):
            key = (mission, attempt, rule)
            if (rule in was) == (rule in new) or key in self._halts:
                continue
            self._halts.add(key)
            orders = self._new.get(rule).order if rule in new else ()
            if rule in new and all(order.each == "gate" for order in orders):
                continue  # premises and alarms see to gates
            broken = f"halted at {running.time_s:.1f} s"
            was_told, now_told = ("went on", broken) if rule in new else (broken, "goes on")
            words = in_words([new.get(rule) or was[rule]])
            done = self._orders(mission, attempt)
            flip = ChangedDecision(
                "halt", mission, attempt, done, (rule,), was_told, now_told, words
            )
            self.found.flips.append(flip)

    def _orders(self, mission: str, number: int) -> str:
        attempt = self._again.state.missions[mission].find(number)
        return orders_of(attempt.plan) if attempt is not None and attempt.plan else ""
