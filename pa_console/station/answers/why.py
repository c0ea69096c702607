"""Reasons for a plan, for the absence of a plan, and against the use of another asset.

They come from the record of a mission, step by step. If the question is about an asset that was not
used, the plan with this asset is checked and rehearsed again in the current picture. This decides
nothing.
"""

import math
from collections.abc import AsyncGenerator, Iterator, Sequence

from pa_console.language.canonical.facts import is_free, sole_covers
from pa_console.language.canonical.reading import asked_words, plain_reading, read_asked
from pa_console.language.name_linking import named
from pa_console.mission.examine import CheckBasis, Examination, examine
from pa_console.policy.rule_variables import goes_to
from pa_console.schema.command import BUSY_TASKS, COMMANDS
from pa_console.schema.events.intake import AnswerLine
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.text import count, few
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World
from pa_console.session.mission_trace import Attempt, MissionTrace, chosen_attempt, rounds
from pa_console.session.wording import deviations_in_words, order_in_words
from pa_console.views.event_words import asked_in_words, references_in_words, standing_in_words
from pa_console.views.status_words import status_of
from pa_console.views.trace_layout import progress

MOST_ASSETS = 6
"""The largest number of a plan's assets that are described one by one; the others are counted."""
_MOST_NEARER = 3
_CLOSE_M = 1.0
"""The difference in distance up to which two assets count as equally near, in metres."""
_MOST_RULES = 8
_MOST_BROKEN = 4
MOST_CHECKED = 4
"""The largest number of named assets that are checked, the nearest first."""


def attempt_of(trace: MissionTrace) -> Attempt | None:
    """Return the attempt that waits or was decided on, or else the last attempt with a plan.

    The result is None if there is no plan yet.
    """
    chosen = chosen_attempt(trace, rounds(trace)[-1])
    if chosen is not None and chosen.plan is not None:
        return chosen
    return next((attempt for attempt in reversed(trace.attempts) if attempt.plan is not None), None)


def asked_of(trace: MissionTrace, attempt: Attempt) -> str:
    """Return the reading that an attempt serves, in canonical words; '' if there is none."""
    request = trace.approval
    if request is not None and request.attempt == attempt.number and request.asked:
        return request.asked
    return asked_words(attempt.plan.reason).rstrip("; ") if attempt.plan is not None else ""


def actions_of(attempt: Attempt | None) -> Sequence[Action]:
    """Return the actions of an attempt's plan; an empty sequence if it has no plan."""
    return attempt.plan.actions if attempt is not None and attempt.plan is not None else ()


def kind_asked_for(words: str, action: Action, world: World) -> AssetKind | None:
    """Return the kind of asset that the order `words` asks for at the place of `action`.

    The result is None if any kind is possible.
    """
    reading = read_asked(words) if words else None
    kind = world.assets[action.agent].kind
    for ask in reading.asks if reading is not None else ():
        if ask.who.kind == kind and ask.place in ("", action.target or ""):
            return kind
    return None


def distance_m(name: str, action: Action, world: World, picture: Picture) -> float | None:
    """Return the distance of an asset from the goal of `action`, in metres; None if unknown."""
    place, asset = goal_of(action, world), picture.assets.get(name)
    if not place or asset is None:
        return None
    return math.dist(asset.position, world.frames[place].at)


def goal_of(action: Action, world: World) -> str:
    """Return the frame to which `action` leads; '' if it leads to none."""
    place = action.target or goes_to(action, world) or ""
    return place if place in world.frames else ""


def is_able(name: str, action: Action, world: World) -> bool:
    """Return whether the asset `name` is of a kind that can carry out `action`."""
    return world.assets[name].kind in COMMANDS[action.verb].kinds


def who_is_able(action: Action) -> str:
    """Return which kinds of asset can carry out `action`, in words."""
    kinds = [PLAIN_KINDS[kind] for kind in PLAIN_KINDS if kind in COMMANDS[action.verb].kinds]
    return f"only a {' or '.join(kinds)} can {action.verb}"


def may_leave(name: str, picture: Picture) -> bool:
    """Return whether an asset may leave without uncovering a gate or giving up its task."""
    asset = picture.assets.get(name)
    return asset is not None and is_free(asset, sole_covers(picture).values())


def against(name: str, picture: Picture) -> list[str]:
    """Return the facts in the picture against the use of an asset; empty if it is free."""
    asset = picture.assets.get(name)
    if asset is None:
        return ["there are no reports about it"]
    alone = [gate for gate, guard in sole_covers(picture).items() if guard == name]
    return [*_state(asset, picture), *(f"it alone covers {gate}" for gate in alone)]


def _state(asset: AssetTelemetry, picture: Picture) -> Iterator[str]:
    age_s = picture.time_s - asset.stamp_s
    if asset.status == "failed":
        yield "it has failed"
    elif asset.comms == "lost" or asset.stale:
        yield f"it has been silent for {age_s:.0f} s"
    elif asset.integrity == "suspect":
        yield "its telemetry cannot be right"
    elif asset.manual:
        yield "it is under manual control"
    elif not asset.available:
        yield "it is not available"
    if asset.low_battery:
        yield f"its battery is low, {asset.battery_pct:.0f} %"
    if asset.task in BUSY_TASKS:
        yield f"it is busy: {asset.task}"


def asset_lines(
    trace: MissionTrace, attempt: Attempt, world: World, only: Sequence[str] = ()
) -> Iterator[AnswerLine]:
    """Yield a line for each asset of the plan; if `only` has names, only for these assets."""
    actions = [a for a in actions_of(attempt) if a.agent in world.assets]
    chosen = [action for action in actions if not only or action.agent in only]
    for action in chosen[:MOST_ASSETS]:
        text = "; ".join((order_in_words(action), *_reasons(trace, attempt, action, world)))
        yield AnswerLine(about=action.agent, said=text)
    if len(chosen) > MOST_ASSETS:
        yield AnswerLine(about="and", said=f"{len(chosen) - MOST_ASSETS} more in the plan")


def not_in_plan(attempt: Attempt, names: Sequence[str]) -> bool:
    """Return whether none of `names` has a part in the plan."""
    return not {action.agent for action in actions_of(attempt)} & set(names)


def _reasons(trace: MissionTrace, attempt: Attempt, action: Action, world: World) -> Iterator[str]:
    """Yield the reasons for the choice of the action's asset, the strongest first."""
    name = action.agent
    if attempt.author != "planner":
        yield f"the {attempt.author} has put it into the plan"
    meant = [
        reference.said for reference in trace.references if name in reference.means.split(", ")
    ]
    if meant:
        yield f"“{meant[0]}” means it"
    elif named([name], trace.mission.text):
        yield "the order names it"
    if len(COMMANDS[action.verb].kinds) < len(KINDS):
        yield who_is_able(action)
    before = attempt.rehearsal.before if attempt.rehearsal is not None else None
    if before is not None and goal_of(action, world):
        yield from _nearness(trace, attempt, action, world, before)
    if attempt.rehearsal is not None:
        arrived_s = attempt.rehearsal.motion.arrived_s.get(name)
        if arrived_s:
            yield f"arrived after {arrived_s:.0f} s in the rehearsal"


def _nearness(
    trace: MissionTrace, attempt: Attempt, action: Action, world: World, before: Picture
) -> Iterator[str]:
    """Yield the asset's distance, and why the nearer assets were not used.

    Assets of the kind that the order asks for are compared. If the order asks for no kind, these
    are all assets of the same kind, and other assets that were free to leave.
    """
    name, place = action.agent, goal_of(action, world)
    own_m = distance_m(name, action, world, before)
    if own_m is None:
        return
    own_kind = world.assets[name].kind
    kind = kind_asked_for(asked_of(trace, attempt), action, world)
    if kind is None and PLAIN_KINDS[own_kind] in trace.mission.text.lower().split():
        kind = own_kind
    planned = {part.agent for part in actions_of(attempt)}
    others = [
        candidate
        for candidate, spec in world.assets.items()
        if candidate not in planned
        and is_able(candidate, action, world)
        and kind in (None, spec.kind)
        if candidate in before.assets and not _stands_at(candidate, place, before)
    ]
    nearer = sorted(
        (other_m, candidate)
        for candidate in others
        if (other_m := distance_m(candidate, action, world, before)) is not None
        and other_m < own_m - _CLOSE_M
        and (world.assets[candidate].kind == own_kind or may_leave(candidate, before))
    )
    kind_word = PLAIN_KINDS[kind] if kind is not None else "asset"
    free = [candidate for _, candidate in nearer if may_leave(candidate, before)]
    if may_leave(name, before) and not free:
        yield f"the nearest free {kind_word}, {own_m:.0f} m away"
    else:
        yield f"{own_m:.0f} m away"
    for other_m, other in nearer[:_MOST_NEARER]:
        why = against(other, before)
        free_too = "and was free: the record has no reason why it was not used"
        remark = f"but {', '.join(why)}" if why else free_too
        yield f"{other} is nearer, {other_m:.0f} m, {remark}"
    if len(nearer) > _MOST_NEARER:
        yield f"{len(nearer) - _MOST_NEARER} more are nearer"


def _stands_at(name: str, place: str, picture: Picture) -> bool:
    """Return whether an asset is at `place` or has its post there."""
    asset = picture.assets[name]
    return place in (asset.post, asset.at)


def _line(about: str, text: str) -> AnswerLine:
    return AnswerLine(about=about, said=text)


def plan_lines(trace: MissionTrace, world: World) -> Iterator[AnswerLine]:
    """Yield all facts about the plan of a mission, or the reasons why it has no plan."""
    yield from order_lines(trace)
    attempt = attempt_of(trace)
    if attempt is not None:
        yield from _reading(trace, attempt)
    yield from rule_lines(trace)
    if attempt is not None:
        yield from asset_lines(trace, attempt, world)
        yield from _not_used(trace, attempt)
        yield from checked_lines(attempt)
    else:
        yield from _without_plan(trace)
    yield from end_lines(trace)


def order_lines(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield the words of the mission, its completed text, and the questions to the operator."""
    mission = trace.mission
    origin = f"{mission.origin}: " if mission.origin else ""
    yield _line("order", f"{mission.id}, {origin}{mission.said}")
    if mission.typed and mission.typed != mission.text:
        meant = references_in_words(trace.references)
        yield _line("put in full", f"{mission.text}{f' ({meant})' if meant else ''}")
    for question in trace.questions:
        choices = f" {' or '.join(question.choices)}" if question.choices else ""
        yield _line("asked back", f"{question.question}{choices}")


def _reading(trace: MissionTrace, attempt: Attempt) -> Iterator[AnswerLine]:
    """Yield the reading of the order, its confidence, its doubts, and its omitted parts."""
    if words := asked_of(trace, attempt):
        yield _line("read as", plain_reading(words))
    if attempt.sure is not None:
        yield _line("how sure", f"{attempt.sure:.0%}")
    again = attempt.read_again
    if again is not None and again.asked:
        yield _line("second reader", plain_reading(again.asked))
    for gap in attempt.gaps:
        yield _line("doubt", gap)
    for unmet in attempt.unmet:
        yield _line("left out", unmet)


def rule_lines(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield the rules in the planner's prompt, each as retrieved or pinned."""
    pinned = [hit.rule_id for hit in trace.hits if hit.pinned]
    retrieved = [hit.rule_id for hit in trace.hits if not hit.pinned]
    if retrieved:
        yield _line("rules", f"retrieved for these words: {few(retrieved, _MOST_RULES)}")
    if pinned:
        yield _line("rules", f"always in the prompt: {few(pinned, _MOST_RULES)}")


def _not_used(trace: MissionTrace, chosen: Attempt) -> Iterator[AnswerLine]:
    """Yield the other plans of the same round, each with the reason why it was not used."""
    for attempt in trace.attempts:
        if attempt is chosen or attempt.round != chosen.round or attempt.plan is None:
            continue
        broken = [f"{f.rule_id}: {f.message}" for f in attempt.findings if f.broken]
        objected = attempt.verdict is not None and attempt.verdict.verdict == "Failure"
        why = broken[:_MOST_BROKEN] or (["the judge objected"] if objected else [])
        if why:
            orders = ", ".join(f"{a.agent} {order_in_words(a)}" for a in attempt.plan.actions)
            yield _line("not used", f"plan {attempt.number} ({orders}): {'; '.join(why)}")


def checked_lines(attempt: Attempt) -> Iterator[AnswerLine]:
    """Yield the results of the checks, the rehearsal and the judge for a plan."""
    if attempt.findings:
        broken = [f for f in attempt.findings if f.broken]
        checked = [f for f in attempt.findings if f.status == "complies"]
        if not broken:
            yield _line("checks", f"no rule is broken; {count(len(checked), 'rule')} applied")
        for finding in broken[:_MOST_BROKEN]:
            worst = "it cannot be approved" if finding.blocking else "a warning"
            yield _line("checks", f"{finding.rule_id} ({worst}): {finding.message}")
        if len(broken) > _MOST_BROKEN:
            yield _line("checks", f"{len(broken) - _MOST_BROKEN} more rules are broken")
    if attempt.rehearsal is not None:
        yield _line("rehearsal", rehearsed_in_words(attempt.rehearsal))
    if attempt.verdict is not None:
        passes = attempt.verdict.verdict == "Success"
        text = "does not object" if passes else f"objects: {attempt.verdict.feedback}"
        yield _line("judge", text)
    elif attempt.judged:
        yield _line("judge", f"gave no verdict: {attempt.judge_error}".rstrip(": "))


def rehearsed_in_words(rehearsal: Rehearsal) -> str:
    """Return a rehearsal in words: its duration, the cover of gates, and unfinished actions."""
    timeline = rehearsal.timeline
    parts = [f"over after {timeline.duration_s:.0f} s"]
    gates = timeline.gates.items()
    lost = [name for name, gate in gates if gate.covered_before and not gate.covered_after]
    bare = [
        f"{name} without a guard for {gate.longest_gap_s:.0f} s on the way"
        for name, gate in gates
        if name not in lost and gate.covered_before and gate.longest_gap_s >= 1.0
    ]
    gained = [name for name, gate in gates if gate.covered_after and not gate.covered_before]
    parts += [f"{', '.join(lost)} lost its guard"] if lost else []
    parts += bare
    parts += [f"{', '.join(gained)} got a guard"] if gained else []
    if not lost and not bare:
        parts.append("every gate kept its guard")
    parts += [
        f"{name} did not finish: {asset.detail}"
        for name, asset in timeline.assets.items()
        if not asset.finished
    ]
    return "; ".join(parts)


def _without_plan(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield the recorded reasons why there is no plan."""
    if trace.standing is not None:
        yield _line("standing order", standing_in_words(trace.standing.order))
        yield _line("approval", asked_in_words(trace.standing.order, trace.standing.allowed))
        return
    attempt = trace.attempts[-1] if trace.attempts else None
    if attempt is not None:
        yield from checked_lines(attempt)
        if attempt.error:
            yield _line("planner", attempt.error)
    if trace.status is None and trace.approval is None:
        how = "".join(span.text for span in progress(trace))
        yield _line("no plan yet", how)


def end_lines(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield the decisions of the operator and the outcome."""
    request = trace.approval
    for made in trace.decisions:
        decision = made.decision
        done = status_of("decision", decision.kind).word
        if decision.kind == "answer":
            done = f"answered “{decision.asked}”"
        shown = decision.standing or bool(deviations_in_words(decision))
        why = f": {decision.reason}" if decision.reason and not shown else ""
        also = f"; {deviations_in_words(decision)}" if deviations_in_words(decision) else ""
        taken = "" if made.accepted else f", not accepted: {made.detail}"
        yield _line("decision", f"{done} by {decision.by}{why}{also}{taken}")
    if trace.voided:
        yield _line("void", trace.voided)
    if request is not None:
        state = status_of("approval", request.state or "none").word
        yield _line("decision", f"it waits for the operator: {state}")
        for why in request.blocked_by:
            yield _line("blocked", why)
    for halt in trace.halts:
        yield _line("halted", "; ".join(halt.reasons))
    if trace.status is not None:
        yield _line("outcome", f"{status_of('mission', trace.status).word}: {trace.reason}")


async def why_not_lines(
    basis: CheckBasis, trace: MissionTrace, attempt: Attempt, names: Sequence[str]
) -> AsyncGenerator[AnswerLine]:
    """Yield the objections to the use of each of `names` instead of the planned asset."""
    world, actions = basis.fleet.world, actions_of(attempt)
    planned = {action.agent: action for action in actions}
    others = [name for name in names if name not in planned]
    for name in names:
        if name in planned and (len(names) == 1 or not others):
            text = f"it is in the plan: {order_in_words(planned[name])}"
            yield AnswerLine(about=name, said=text)
    nearest = sorted(others, key=lambda name: _distance_to_part(name, actions, world, basis))
    for name in nearest[:MOST_CHECKED]:
        async for text in _checked(basis, trace, attempt, name):
            yield AnswerLine(about=name, said=text)
    if len(nearest) > MOST_CHECKED:
        text = f"{len(nearest) - MOST_CHECKED} more are farther away and were not checked"
        yield AnswerLine(about="and", said=text)


def part_for(name: str, actions: Sequence[Action], world: World) -> Action | None:
    """Return the action that an asset would take over; None if it can carry out none of `actions`.

    An action of an asset of the same kind is preferred.
    """
    movers = [action for action in actions if goal_of(action, world)]
    able = [action for action in movers or actions if is_able(name, action, world)]
    kind = world.assets[name].kind
    alike = [action for action in able if action.agent in world.assets]
    alike = [action for action in alike if world.assets[action.agent].kind == kind]
    return next(iter((*alike, *able)), None)


def _distance_to_part(
    name: str, actions: Sequence[Action], world: World, basis: CheckBasis
) -> float:
    part, picture = part_for(name, actions, world), basis.fleet.picture()
    distance = distance_m(name, part, world, picture) if part is not None else None
    return float("inf") if distance is None else distance


async def _checked(
    basis: CheckBasis, trace: MissionTrace, attempt: Attempt, name: str
) -> AsyncGenerator[str]:
    """Yield the facts against one asset, and the results of checks and rehearsal with it."""
    world, actions = basis.fleet.world, actions_of(attempt)
    part = part_for(name, actions, world)
    if part is None:
        first = next((action for action in actions if goal_of(action, world)), None)
        yield who_is_able(first) if first is not None else "the plan sends no asset anywhere"
        return
    over = trace.approval is None
    picture_then = attempt.rehearsal.before if attempt.rehearsal is not None else None
    if over and picture_then is not None:
        yield f"when it was planned: {_facts(name, part, attempt, trace, world, picture_then)}"
    now = basis.fleet.picture()
    with_it = Plan(
        reason=attempt.plan.reason if attempt.plan is not None else "",
        actions=tuple(
            action.model_copy(update={"agent": name}) if action is part else action
            for action in actions
        ),
    )
    examination = await examine(
        with_it, trace.mission, basis.fleet, basis.rulebook, variant=basis.variant
    )
    if not over:
        yield _facts(name, part, attempt, trace, world, now)
    yield f"{'now ' * over}in place of {part.agent}: {_verdict(examination)}"
    if examination.rehearsal is not None:
        compared = attempt.rehearsal if not over else None
        yield _arrival(name, part, examination.rehearsal, compared)


def _facts(  # noqa: PLR0917 - one asset in one plan, in one picture
    name: str, part: Action, attempt: Attempt, trace: MissionTrace, world: World, picture: Picture
) -> str:
    """Return the facts in the picture and the order against the use of an asset for an action."""
    facts = [*_not_asked_for(name, part, attempt, trace, world), *against(name, picture)]
    own_m = distance_m(name, part, world, picture)
    their_m = distance_m(part.agent, part, world, picture)
    if own_m is not None and their_m is not None:
        facts.append(f"{own_m:.0f} m away, {part.agent} {their_m:.0f} m")
    return "; ".join(facts) or "nothing in the picture speaks against it"


def _not_asked_for(
    name: str, part: Action, attempt: Attempt, trace: MissionTrace, world: World
) -> Iterator[str]:
    """Yield a fact if the order was read as asking for another kind of asset."""
    kind = kind_asked_for(asked_of(trace, attempt), part, world)
    if kind is not None and world.assets[name].kind != kind:
        yield f"the order was read as asking for a {PLAIN_KINDS[kind]}"


def _verdict(examination: Examination) -> str:
    if examination.blocked:
        return f"it cannot be approved: {'; '.join(examination.faults)}"
    if examination.broken:
        return f"a warning: {'; '.join(examination.broken)}"
    return "no rule is broken"


def _arrival(name: str, part: Action, rehearsal: Rehearsal, planned: Rehearsal | None) -> str:
    """Return the result of the rehearsal with the asset, and the arrival times of both assets."""
    arrived_s = rehearsal.motion.arrived_s.get(name)
    there = f"; it arrives after {arrived_s:.0f} s" if arrived_s is not None else ""
    other_s = planned.motion.arrived_s.get(part.agent) if planned is not None else None
    if there and other_s is not None:
        there += f", {part.agent} after {other_s:.0f} s"
    return f"rehearsed: {rehearsed_in_words(rehearsal)}{there}"
