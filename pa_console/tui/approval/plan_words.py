"""The words of the approval panel: order, actions, consequences, rules, judge, confidence.

A doubt about the reading comes before the consequences. The row of an action shows its agent,
places, duration and charge: `Drone_T04 UAV Checkpoint → East Gate 7 s battery 97 → 95 %`.
Equal actions share a row.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from textual.content import Content

from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import asked_words, place_words, plain_reading
from pa_console.llm.roles.grammar import PLANNED
from pa_console.mission.approval import people_words
from pa_console.schema.command import COMMANDS
from pa_console.schema.events.event import ApprovalRequested, StandingOrderRead
from pa_console.schema.mission import ELSEWHERE, Mission, StandingOrder
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.text import clock_text, count
from pa_console.session.confidence import UNSURE
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.tui.plan_preview import PlanPreview
from pa_console.tui.rows import Part, WrappedRow, fact, phrased, row
from pa_console.tui.status_words import BAD, CALM, GOOD, KIND_WORDS, NOTE, QUIET, WARN, term
from pa_console.views.event_words import (
    asked_in_words,
    in_steps,
    moments_in_words,
    safety_in_words,
    step_lines,
)

YOUNG_S = 10.0
"""The minimum age in seconds of a plan whose age is shown."""


@dataclass(frozen=True)
class _ActionGroup:
    """The description of an action, without its agent; equal actions share a description."""

    kind: str
    way: str
    does: str
    moves: bool


def action_rows(preview: PlanPreview) -> Iterator[WrappedRow]:
    """Yield a row for each action of a rehearsed plan; equal actions share a row."""
    groups: dict[_ActionGroup, list[Action]] = {}
    for action in preview.plan.actions:
        groups.setdefault(_deed(action, preview), []).append(action)
    for deed, actions in groups.items():
        yield _row(deed, actions, preview)


def step_rows(preview: PlanPreview) -> Iterator[WrappedRow]:
    """Yield a row for each line of a plan in steps, then its duration and changes of guards."""
    for line in step_lines(preview.plan):
        when: list[Part] = [(line.when, NOTE)] if line.when else []
        lead = f"{line.numbers}  {line.agent}  "
        yield phrased((lead, "bold"), [line.does, *when])
    names = tuple(dict.fromkeys(preview.plan.agents))
    spent: list[Part] = [f"{preview.duration_s:.0f} s in all", (_battery(names, preview), QUIET)]
    spent += [(why, WARN) for why in _unfinished(names, preview)]
    yield phrased(("Steps  ", QUIET), spent)
    if changed := cover_row(preview):
        yield changed


def age_words(trace: MissionTrace, now_s: float) -> tuple[str, str]:
    """Return the age of the waiting plan, with and without the age of its rehearsal.

    Both are '' for a young plan; for a timed order, they are the time until its start.
    """
    request = trace.approval
    if request is not None and request.standing is not None and trace.standing is not None:
        first_s = trace.standing.first_s
        left = f"in {clock_text(max(first_s - now_s, 0.0))}" if first_s is not None else ""
        return left, left
    attempt = trace.find(request.attempt) if request is not None else None
    if attempt is None or attempt.rehearsal is None or attempt.made_s is None:
        return "", ""
    made_s, rehearsed_s = now_s - attempt.made_s, now_s - attempt.rehearsal.before.time_s
    if made_s < YOUNG_S:
        return "", ""
    old = f"{_age(made_s)} old"
    if rehearsed_s == made_s:
        return old, old
    again = f"{_age(rehearsed_s)} ago" if rehearsed_s >= YOUNG_S else "just now"
    return f"{old}, rehearsed {again}", old


def _age(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def unrehearsed_row(action: Action) -> WrappedRow:
    """Return the row of an action of a plan that could not be rehearsed."""
    return row((f"{action.agent}  ", "bold"), action.command)


def cover_row(preview: PlanPreview) -> WrappedRow | None:
    """Return a row with the gates that gain or lose guards; None if there are none."""
    phrases: list[Part] = []
    for gate, change in preview.cover_changes.items():
        words = f"{place_words(gate)} {change.before} → {change.after}"
        if not change.after:
            words += ", none left"
        elif change.longest_gap_s:
            words += f", none for {change.longest_gap_s:.0f} s"
        phrases.append((words, BAD if change.loses else ""))
    return phrased(("Guards  ", QUIET), phrases) if phrases else None


def _deed(action: Action, preview: PlanPreview) -> _ActionGroup:
    asset = preview.before.assets.get(action.agent)
    kind = KIND_WORDS[asset.kind].removeprefix("ground ") if asset is not None else "unknown kind"
    goal, does = preview.goal(action), COMMANDS[action.verb].plainly
    if preview.is_there(action):
        stays = "holds" if action.verb == "hold" else "stays"
        way = f"{stays} {_where(asset)}" if action.verb != "report" else _where(asset)
        return _ActionGroup(kind, way, does, moves=False)
    return _ActionGroup(kind, f"{_from(asset)} → {place_words(goal)}", does, moves=True)


def _from(asset: AssetTelemetry | None) -> str:
    return place_words(asset.at) if asset is not None and asset.at else "under way"


def _where(asset: AssetTelemetry | None) -> str:
    if asset is None:
        return "where it is"
    if asset.at is not None:
        return f"at {place_words(asset.at)}"
    return f"on its way to {place_words(asset.post)}" if asset.post else "where it is"


def _row(deed: _ActionGroup, actions: Sequence[Action], preview: PlanPreview) -> WrappedRow:
    names = [action.agent for action in actions]
    many = len(names) > 1
    kinds = deed.kind if deed.kind.endswith("s") else f"{deed.kind}s"
    lead = f"{len(names)} {kinds}  " if many else f"{names[0]}  "
    phrases: list[Part] = [] if many else [(deed.kind, QUIET)]
    phrases += [f"{deed.way},", deed.does] if deed.does else [deed.way]
    if deed.moves and (seconds := _seconds(names, preview)):
        phrases.append(seconds)
    phrases.append((_battery(names, preview), QUIET))
    phrases += [(why, WARN) for why in _unfinished(names, preview)]
    if many:
        phrases.append((", ".join(names), "bold"))
    return phrased((lead, "bold"), phrases)


def _seconds(names: Sequence[str], preview: PlanPreview) -> str:
    arrivals = sorted(at for name in names if (at := preview.arrival_s(name)) is not None)
    if not arrivals:
        return ""
    first, last = f"{arrivals[0]:.0f}", f"{arrivals[-1]:.0f}"
    return f"{last} s" if first == last else f"{first} to {last} s"


def _battery(names: Sequence[str], preview: PlanPreview) -> str:
    """Return the lowest charge of the agents before the plan and their lowest charge during it."""
    lines, assets = preview.rehearsal.timeline.assets, preview.before.assets
    before = [assets[name].battery_pct for name in names if name in assets]
    least = [lines[name].least_battery_pct for name in names if name in lines]
    if not before:
        return "battery unknown"
    first = f"{min(before):.0f}"
    last = f"{min(least):.0f}" if least else first
    return f"battery {first} %" if first == last else f"battery {first} → {last} %"


def _unfinished(names: Sequence[str], preview: PlanPreview) -> Iterator[str]:
    for name in names:
        line = preview.rehearsal.timeline.assets.get(name)
        if line is not None and not line.finished:
            yield f"{name}: {line.detail or 'does not finish'}"


def approval_rows(
    trace: MissionTrace, preview: PlanPreview | None = None, foreseen: str = ""
) -> Iterator[WrappedRow]:
    """Yield all facts about the waiting plan; none if no plan waits.

    `preview` is its rehearsal, None if it was not rehearsed. `foreseen` describes the plan that a
    timed order would have now.
    """
    request = trace.approval
    if request is None:
        return
    attempt = trace.find(request.attempt)
    refused = trace.decisions[-1] if trace.decisions and not trace.decisions[-1].accepted else None
    if refused is not None and not refused.decision.signatures:
        yield row("✘ ", (f"not accepted: {refused.detail}", BAD))
    yield from _order(trace, request)
    if trace.still is not None and trace.still.problem:
        problem = f"{trace.still.camera}, {trace.still.track}: {trace.still.problem}"
        yield row(("△ ", WARN), ("No still  ", f"bold {WARN}"), problem)
    if request.state == "not_understood":
        problem = "; ".join(request.blocked_by).removeprefix("not understood: ")
        yield row(("? ", WARN), (problem, WARN))
        remedy = "Choose or type what you mean" if trace.choices else "Type what you mean"
        yield row("  ", f"No asset moves. {remedy}, or reject this.")
        return
    if request.standing is not None and trace.standing is not None:
        yield from offered_rows(trace.standing, foreseen)
        yield from _blocked(request)
        return
    for text in attempt.unmet if attempt else ():
        yield row(("△ ", WARN), ("Not done: ", f"bold {WARN}"), _because(text))
    yield from _phase(trace, attempt)
    yield from _actions(request, preview)
    yield from _blocked(request)
    if request.approvals:
        yield row(("▲ ", WARN), ("People  ", f"bold {WARN}"), people_words(request.approvals))
        yield from _signed(trace, request)
    for rule_id in request.acknowledge:
        yield row(("▲ ", WARN), (f"{rule_id}  ", f"bold {WARN}"), _message(trace, rule_id))
    yield _judge(attempt, request)
    if attempt is not None and not request.readings:
        yield from _confidence(attempt)


def _order(trace: MissionTrace, request: ApprovalRequested) -> Iterator[WrappedRow]:
    """Yield the order as it was typed, and its reading."""
    mission, attempt = trace.mission, trace.find(request.attempt)
    labels = {
        "operator": "typed  ",
        "alarm": "alarm  ",
        "standing": f"by {mission.standing}  ",
        "agent": "order  ",
    }
    if mission.agent:
        yield row(("▲ ", WARN), (mission.origin[0].upper() + mission.origin[1:], f"bold {WARN}"))
    again = request.attempt > 1 and len(request.plan.steps) == 1
    later = [(f"  (plan {request.attempt})", QUIET)] if again else []
    void = trace.find(trace.voided_attempt)
    if void is not None and attempt is not None and void.round == attempt.round:
        yield row(
            ("△ ", WARN), (f"Plan {void.number} was withdrawn  ", f"bold {WARN}"), trace.voided
        )
    if mission.offered:
        yield row(("▶ ", NOTE), ("Low-battery policy of this world. ", f"bold {NOTE}"),
                  "Approve it once, and it acts while you are away; reject it, and every asset "
                  "with a low battery waits for your order.")  # fmt: skip
    name = "policy " if mission.offered else labels[mission.source]
    yield row((name, QUIET), *typed_words(mission), *later)
    asked = asked_words(attempt.plan.reason).rstrip("; ") if attempt and attempt.plan else ""
    if asked and not request.readings:
        yield row(("read   ", QUIET), plain_reading(asked))


def typed_words(mission: Mission) -> Iterator[str | tuple[str, str]]:
    """Yield an order as it was typed; after a word that was read differently, yield the reading."""
    typed, read = mission.said.split(), mission.text.split()
    if len(typed) != len(read):
        yield mission.said
        if typed != read:
            yield (f" (read: {mission.text})", WARN)
        return
    for number, (word, reading) in enumerate(zip(typed, read, strict=True)):
        yield f"{' ' * bool(number)}{word}"
        if word != reading:
            yield (f" (read: {reading})", WARN)


def _because(unmet: str) -> str:
    """Return `unmet`, which has an impossible part and a reason after a colon, as one sentence."""
    part, colon, reason = unmet.partition(": ")
    return f"{part}, because {reason}" if colon else part


def _signed(trace: MissionTrace, request: ApprovalRequested) -> Iterator[WrappedRow]:
    """Yield the people who have signed the plan so far, and whether others have to sign it too."""
    made = [event for event in trace.decisions if event.attempt == request.attempt]
    signers = dict.fromkeys(name for event in made for name in event.decision.signatures)
    if not signers:
        return
    away = {name for name in signers if any(f"{name} {ELSEWHERE}" in d.decision.by for d in made)}
    signed = ", ".join(f"{name} {ELSEWHERE}" if name in away else name for name in signers)
    yield row(("✔ ", GOOD), ("Signed  ", f"bold {GOOD}"), (signed, GOOD))
    if not made[-1].accepted:
        yield row("  ", (f"{made[-1].detail}; others sign with console --join", NOTE))


def _phase(trace: MissionTrace, attempt: Attempt | None) -> Iterator[WrappedRow]:
    """Yield the workflow phase that the plan is for, and whether that phase has changed."""
    planned = attempt.phase if attempt else ""
    now = next((m for m in trace.standings.values() if 0 <= m.phase < len(m.phases)), None)
    if now is not None:
        name = now.phases[now.phase]
        moved = f"; the plan was made for {planned}" if planned not in ("", name) else ""
        yield row(("▶ ", NOTE), (f"phase {name} of {now.track}", NOTE), moved)
    elif planned:
        yield row(("▶ ", NOTE), (f"phase {planned}", NOTE), ", which is over")


def _actions(request: ApprovalRequested, preview: PlanPreview | None) -> Iterator[WrappedRow]:
    if not request.plan.actions:
        yield row("", "nothing moves: the plan has no action")
    elif preview is None:
        yield from map(unrehearsed_row, request.plan.actions)
    elif in_steps(preview.plan):
        yield from step_rows(preview)
    else:
        yield from action_rows(preview)
        if changed := cover_row(preview):
            yield changed
    if request.if_halted and not request.blocked_by:
        yield row("  ", ("if halted: ", NOTE), safety_in_words(request.if_halted))


def _blocked(request: ApprovalRequested) -> Iterator[WrappedRow]:
    for reason in request.blocked_by:
        yield row(("✘ ", BAD), ("Blocked  ", f"bold {BAD}"), (reason, BAD))


def _judge(attempt: Attempt | None, request: ApprovalRequested) -> WrappedRow:
    if attempt is None or not attempt.judged:
        return row(("? ", WARN), ("Judge: not asked", f"bold {WARN}"))
    given = attempt.verdict
    mark = term("verdict", given.verdict if given else "none")
    if given is not None and given.verdict == "Success":
        style = GOOD if request.state == "approve" else QUIET
        sign = f"{mark.glyph} " if style == GOOD else "· "
        broken = request.blocked_by or request.acknowledge
        words = (
            "The judge does not object"
            if broken
            else "No rule is broken, the judge does not object"
        )
        return row((sign, style), (words, style))
    if given is None:
        words, why = "Judge: no verdict  ", attempt.judge_error
    else:
        words, why = "Judge objects: ", objection(given.feedback)
    return row((f"{mark.glyph} ", mark.style), (words, f"bold {mark.style}"), (why, mark.style))


def objection(feedback: str) -> str:
    """Return a judge's feedback in plain words: the order, the plan, and the fault."""
    asked, planned, rest = feedback.partition(PLANNED)
    if not planned:
        return feedback
    does, _, why = rest.partition("; ")
    difference = f"the order says {plain_reading(asked)}, the plan {plain_reading(does)}"
    return f"{difference}: {why}" if why else difference


def _confidence(attempt: Attempt) -> Iterator[WrappedRow]:
    """Yield the models' confidence in the reading, and the mismatches between reading and order."""
    gaps = "; ".join(attempt.gaps)
    if attempt.sure is None:
        if gaps:
            yield row(("△ ", WARN), ("May be misread: ", f"bold {WARN}"), gaps)
        return
    unsure = attempt.sure < UNSURE or bool(gaps)
    style, sign = (WARN, "△ ") if unsure else (QUIET, "· ")
    meaning = "the order may mean something else" if unsure else "the order is understood"
    words = f"Confidence {attempt.sure:.0%}: "
    yield row(
        (sign, style), (words, f"bold {style}"), (f"{meaning}; {gaps}" if gaps else meaning, style)
    )


def _message(trace: MissionTrace, rule_id: str) -> str:
    findings = (f for attempt in reversed(trace.attempts) for f in attempt.findings)
    return next((f.message for f in findings if f.rule_id == rule_id), "")


def reading_rows(trace: MissionTrace) -> Iterator[WrappedRow]:
    """Yield the reading of an order that may mean something else."""
    request = trace.approval
    if request is None or not request.readings:
        return
    attempt, asked = trace.find(request.attempt), plain_reading(request.asked)
    if attempt is not None and attempt.as_chosen:
        yield row(("✎ ", NOTE), "read as you meant it: ", asked)
        return
    sure = attempt.sure if attempt is not None else None
    differs = request.read_apart and (sure is None or sure >= UNSURE)
    doubt = "Another reader differs" if differs else "Unsure"
    confidence = f" with {sure:.0%} confidence" if sure is not None else ""
    yield row(("△ ", WARN), (f"{doubt}  ", f"bold {WARN}"), f"read{confidence} as: {asked}")


def looked_at_rows(preview: PlanPreview | None, faults: tuple[str, ...]) -> Iterator[WrappedRow]:
    """Yield the consequences of another reading, and the rules that block it."""
    if preview is None:
        yield row("  ", ("The effects are known once this reading is planned.", QUIET))
        return
    yield from action_rows(preview)
    if changed := cover_row(preview):
        yield changed
    for fault in faults:
        yield row(("✘ ", BAD), (fault, BAD))
    yield row("  ", ("If you choose this reading, the plan may use other assets.", QUIET))


def reading_label(number: int, asked: str) -> Content:
    """Return the label of a possible meaning of the order, preceded by the key that shows it."""
    or_ = "or: " if asked.startswith(ASKED) else ""
    return Content.assemble((f"(Alt+{number}) ", "bold"), or_, plain_reading(asked))


def offered_rows(read: StandingOrderRead, foreseen: str = "") -> Iterator[WrappedRow]:
    """Yield all facts about a standing order before its approval.

    `foreseen` describes the plan that the order would have now; it is '' if this is unknown.
    """
    if read.order.once and read.moments:
        yield row(("▶ ", NOTE), (f"Will run once at {moments_in_words(read.moments)}", "bold"),
                  f", as {read.order.id}; it is planned and checked then")  # fmt: skip
        yield fact("order", read.order.order_in_words)
        yield fact("approval", asked_in_words(read.order, read.allowed))
    else:
        holds = "in force from your approval until you revoke it or the session ends"
        yield row(("▶ ", NOTE), (f"Standing order {read.order.id}: ", f"bold {NOTE}"), holds)
        yield from order_rows(read.order, read.allowed)
        if read.order.schedule is not None:
            yield fact("next", (moments_in_words(read.moments), "bold"))
    if foreseen:
        yield fact("now", foreseen.removeprefix("reads as: "))
    for start in () if read.order.once else read.now:
        about = f"{start.subject}: " * bool(start.subject)
        yield fact("now", (about, "bold"), (start.order, WARN))
    if not read.now and read.order.condition:
        yield fact("now", "no mission now: the condition is not met")


def order_rows(
    order: StandingOrder, allowed: Collection[str] | None = None
) -> Iterator[WrappedRow]:
    """Yield a standing order's condition in words and as CEL, its missions and its approvals."""
    if order.ban is not None:
        yield fact("ban", (order.order, "bold"))
        return
    if order.schedule is None:
        yield fact("whenever", (order.words, "bold"))
        yield fact("in CEL", (order.condition, CALM))
    else:
        yield fact("times", (order.words, "bold"))
    yield fact("it starts", order.order_in_words)
    style = WARN if order.unasked else ""
    yield fact("approval", (asked_in_words(order, allowed), style))
    if order.schedule is None:
        yield fact("limit", f"{count(order.most_an_hour, 'start')} an hour")
