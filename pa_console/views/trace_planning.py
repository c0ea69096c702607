"""Steps 3 to 7 of a mission's trace: rules, picture, plan, checks, judge, and approval."""

import json
import re
from collections.abc import Collection, Iterator, Mapping
from typing import cast

from pa_console.language.canonical.reading import plain_reading
from pa_console.schema.events.event import ApprovalRequested, OrderReadAgain
from pa_console.schema.finding import Finding, Usage, Verdict
from pa_console.schema.plan import Action
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    Rehearsal,
    Timeline,
    TrackTimeline,
)
from pa_console.schema.rule import PRIORITIES, SHORT, Rule
from pa_console.schema.telemetry import Digest, Selection
from pa_console.schema.text import count, duration_text
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.views.event_words import in_steps, safety_in_words, when_in_words
from pa_console.views.rule_trail import DecisionEvidence
from pa_console.views.status_words import Status, Tone, status_of
from pa_console.views.trace_parts import (
    Block,
    Column,
    Detail,
    Span,
    Text,
    TraceLine,
    TraceOptions,
    TraceSection,
    TraceTable,
    labelled,
    sign,
    statement,
    table,
)

Rules = Mapping[str, Rule]
"""The rules of the session by id; a missing rule is shown as unknown."""

_LABEL = 10
_MOST_URGENT_FIRST = {priority: rank for rank, priority in enumerate(PRIORITIES)}

_JSON_PART = re.compile(
    r'(?P<name>"(?:[^"\\]|\\.)*"(?=\s*:))|(?P<text>"(?:[^"\\]|\\.)*")|(?P<value>[\w.+-]+)|(?P<sign>.)'
)
_JSON_TONES: Mapping[str, Tone] = {"name": "note", "text": "calm", "value": "good", "sign": "quiet"}
MOST_GATES = 12
"""The maximum number of gates that a rehearsal lists in full; of more, it lists those affected."""


def retrieved_rules(trace: MissionTrace, rules: Rules, options: TraceOptions) -> TraceSection:
    """Return step 3: each rule with its text and the parts of its score, and the rule set.

    Retrieved rules come before pinned ones, which are in every prompt whatever their score.
    """
    hits = sorted(trace.hits, key=lambda hit: hit.pinned)
    places = 3 if options.detail >= Detail.RECORD else 2
    columns = [
        Column("rule", 7, stress="bold"),
        Column("score", 4, "calm"),
        Column("pinned", tone="note"),
        Column("components", tone="quiet"),
    ]
    rows = [
        [
            hit.rule_id,
            f"{hit.score:.{places}f}",
            "pinned" if hit.pinned else "",
            " ".join(f"{name} {value:.{places}f}" for name, value in hit.components.items()),
        ]
        for hit in hits
    ]
    if options.detail >= Detail.FULL:
        columns.append(Column("text", below=4))
        for row, hit in zip(rows, hits, strict=True):
            rule = rules.get(hit.rule_id)
            row.append(rule.text if rule else "(not in this rulebook)")
    under = f", set {trace.rules[:SHORT]}" if trace.rules else ""
    note = f"{len(trace.hits)} by {trace.method}, {duration_text(trace.retrieval_s)}{under}"
    return TraceSection("rules", "Rules retrieved", (table(columns, rows),), step=3, note=note)


def pictures(given: Digest, options: TraceOptions, key: str = "") -> Iterator[TraceSection]:
    """Yield step 3: the picture in the prompts; `key` distinguishes the attempts."""
    yield _digest(given, options, f"digest{key}")
    if given.selection is not None:
        yield _selection(given.selection, f"selection{key}")


def _digest(given: Digest, options: TraceOptions, key: str) -> TraceSection:
    cover = "  ".join(f"{gate}×{number}" for gate, number in given.covered.items())
    free = [f"{kind}: {', '.join(names) or 'none'}" for kind, names in given.free.items()]
    sole = [f"{asset} for {gate}" for gate, asset in given.sole_cover.items()]
    lines = [
        _fact("cover", cover),
        _fact("uncovered", ", ".join(given.uncovered), "bad"),
        _fact("free", "; ".join(free)),
        _fact("sole cover", ", ".join(sole)),
        _fact("down", ", ".join(given.down), "bad"),
        *(_fact("unknown", line, "warn") for line in given.unknown),
        _fact("low", ", ".join(given.low_battery), "warn"),
        _fact("weak link", ", ".join(given.degraded_comms), "warn"),
        *(_fact("track", line, "warn") for line in given.tracks),
    ]
    if options.detail >= Detail.RECORD:
        lines += [_fact("post", f"{asset}: {post}") for asset, post in given.posts.items()]
    lost = status_of("gate", "uncovered") if given.uncovered else None
    return TraceSection(key, "Picture", tuple(lines), step=3, mark=lost)


def _fact(label: str, text: str, tone: Tone = "") -> TraceLine:
    span = Span(text, tone) if text else Span("none", "quiet")
    return TraceLine((span,), label, "quiet", width=_LABEL)


def _selection(given: Selection, key: str) -> TraceSection:
    """Return the part of the picture in the prompt, with reasons; the rest is only counted."""
    kinds = (("gate", given.gates), ("track", given.tracks), ("asset", given.assets))
    columns = (
        Column("kind", 6, "quiet"),
        Column("name", 11, stress="bold"),
        Column("why", tone="quiet"),
    )
    rows = [(kind, name, why) for kind, names in kinds for name, why in names.items()]
    left = [count(number, kind[:-1]) for kind, number in given.left_out.items() if number]
    rest = f"left out: {', '.join(left) or 'nothing'}"
    picked = ", ".join(count(len(names), kind) for kind, names in kinds)
    note = f"{picked}; left out {', '.join(left) or 'nothing'}"
    blocks = (table(columns, rows), statement(rest, "note"))
    return TraceSection(key, "Shown to the model", blocks, step=3, note=note, collapsed=True)


def prompt(attempt: Attempt) -> TraceSection:
    """Return step 4: the whole prompt as it was sent."""
    blocks = (
        Text(attempt.system, "system", verbatim=True),
        Text(attempt.user, "user", verbatim=True),
    )
    note = f"{len(attempt.system) + len(attempt.user)} characters"
    key = f"prompt-{attempt.number}"
    return TraceSection(key, "Prompt", blocks, step=4, note=note, collapsed=True)


def _unfinished(over: bool) -> Status:
    """Return the status of a step without a result, in a mission that is `over` or not."""
    return status_of("step", "interrupted" if over else "active")


def plan(attempt: Attempt, *, over: bool = False) -> TraceSection:
    """Return step 4: the answer while it streams, then the plan parsed from it.

    `over` is True if the mission has finished.
    """
    usage, read, key = attempt.usage, attempt.plan, f"plan-{attempt.number}"
    if read is None:
        unreadable = Status("✘", "unreadable", "bad")
        mark = unreadable if attempt.error else _unfinished(over)
        blocks: list[Block] = [Text(attempt.text, verbatim=True)] if attempt.text else []
        blocks += [statement(attempt.error, "bad")] if attempt.error else []
        return TraceSection(key, "Plan", tuple(blocks), step=4, mark=mark)
    blocks = [TraceLine((Span(read.reason, stress="italic"),))]
    columns = (
        Column("#", 2, "quiet"),
        Column("asset", 11, stress="bold"),
        Column("command", tone="calm"),
        Column("target"),
    )
    actions = [
        (f"{number}", action.agent, action.verb, action.target or "")
        for number, action in enumerate(read.actions, start=1)
    ]
    if in_steps(read):
        columns = (*columns, Column("when", tone="note"))
        actions = [
            (*cells, f"{when_in_words(read, number)}{_stay(read.actions[number - 1])}")
            for number, cells in enumerate(actions, start=1)
        ]
    blocks.append(
        table(columns, actions) if actions else statement("no action: nothing would move", "quiet")
    )
    if attempt.if_halted:
        blocks.append(labelled("if halted", safety_in_words(attempt.if_halted)))
    blocks += [_warning("not met", text) for text in attempt.unmet]
    blocks += [_warning("unsure", attempt.doubt)] if attempt.doubt else []
    spent = f"{count(usage.completion_tokens, 'token')}, {_took(usage)}"
    note = f"by the {attempt.author}" if attempt.author != "planner" else spent
    return TraceSection(key, "Plan", tuple(blocks), step=4, note=note)


def _stay(action: Action) -> str:
    return f"; stays {action.stay_s:g} s" if action.stay_s else ""


def plan_json(attempt: Attempt) -> TraceSection:
    """Return the answer behind the plan as JSON, with one action per line."""
    lines = tuple(_json_line(line) for line in _json_lines(attempt.text))
    note = f"as the {attempt.author if attempt.author != 'planner' else 'model'} wrote it"
    return TraceSection(
        f"answer-{attempt.number}", "Plan as JSON", lines, step=4, note=note, collapsed=True
    )


def _json_lines(text: str) -> list[str]:
    """Return the lines of a JSON object, one per field and list item; else those of `text`."""
    try:
        read: object = json.loads(text)
    except ValueError:
        return text.splitlines()
    if not isinstance(read, dict):
        return text.splitlines()
    fields = [
        f"  {json.dumps(name)}: {_json_value(value)}"
        for name, value in cast(dict[str, object], read).items()
    ]
    return ["{", *",\n".join(fields).split("\n"), "}"]


def _json_value(value: object) -> str:
    if not isinstance(value, list) or not value:
        return json.dumps(value, ensure_ascii=False)
    items = [f"    {json.dumps(item, ensure_ascii=False)}" for item in cast(list[object], value)]
    return "\n".join(["[", ",\n".join(items), "  ]"])


def _json_line(line: str) -> TraceLine:
    """Return a line of JSON with separate tones for names, texts, other values and signs."""
    bare = line.lstrip(" ")
    spans = (
        Span(match[0], _JSON_TONES[match.lastgroup or "sign"])
        for match in _JSON_PART.finditer(bare)
    )
    return TraceLine(tuple(spans), depth=(len(line) - len(bare)) // 2)


def _warning(label: str, text: str) -> TraceLine:
    return TraceLine((Span(text),), label, "warn", width=_LABEL + 1)


def _took(usage: Usage) -> str:
    """Return the time that a model took, and the part of it before the order was sent."""
    before = f" ({duration_text(usage.ahead_s)} before Enter)" if usage.ahead_s else ""
    return duration_text(usage.seconds) + before


def answer(key: str, title: str, text: str, usage: Usage, step: int) -> TraceSection:
    """Return a model's answer word for word, with its cost."""
    cost = (
        f"{usage.prompt_tokens} prompt tokens ({usage.cached_tokens} cached), "
        f"{usage.completion_tokens} written, first after {duration_text(usage.first_token_s)}, "
        f"{_took(usage)} in all"
    )
    note = cost if usage.completion_tokens else ""
    blocks = (Text(text, verbatim=True),)
    return TraceSection(key, title, blocks, step=step, note=note, collapsed=True)


def rehearsal(attempt: Attempt, run: Rehearsal, options: TraceOptions) -> TraceSection:
    """Return the effects of the rehearsed plan on each gate, asset and track."""
    timeline = run.timeline
    gates = timeline.gates
    everything = len(gates) <= MOST_GATES or options.detail >= Detail.RECORD
    shown = gates if everything else _affected(attempt, timeline)
    columns = (Column("gate", 11), Column("state", 12), Column("gap", tone="quiet"))
    rows = [(gate, *_gate(line)) for gate, line in shown.items()]
    blocks: list[Block] = [table(columns, rows)]
    if left := len(gates) - len(shown):
        blocks.append(statement(f"{count(left, 'more gate')}: covered, no gap", "quiet"))
    if timeline.assets:
        columns = (Column("asset", 11), Column("state", 12), Column("rehearsed", tone="quiet"))
        rows = [(asset, *_asset(line)) for asset, line in timeline.assets.items()]
        blocks.append(table(columns, rows))
    if timeline.tracks and options.detail >= Detail.RECORD:
        blocks.append(_tracks(timeline))
    lost = [gate for gate, line in gates.items() if not line.covered_after]
    mark = (
        Status("✘", f"loses {', '.join(lost)}", "bad")
        if lost
        else Status("✔", "all gates covered", "good")
    )
    note = f"{timeline.duration_s:.0f} s rehearsed in {duration_text(attempt.rehearsal_s)}"
    key = f"rehearsal-{attempt.number}"
    return TraceSection(key, "Rehearsal", tuple(blocks), step=5, mark=mark, note=note)


def _gate(line: GateTimeline) -> tuple[Status, str]:
    mark = status_of("gate", "covered" if line.covered_after else "uncovered")
    gap = f"longest gap {line.longest_gap_s:.0f} s" if line.longest_gap_s else "no gap"
    return mark, gap if line.covered_before else f"not covered before, {gap}"


def _asset(line: AssetTimeline) -> tuple[Status, str]:
    facts = [f"{line.travelled_m:.0f} m", f"battery {line.least_battery_pct:.0f} %"]
    facts += [f"entered {zone}" for zone in line.entered_zones]
    facts += ["left the perimeter"] if line.left_perimeter else []
    facts += [line.detail] if line.detail else []
    return status_of("reply", "done" if line.finished else "failed"), ", ".join(facts)


def _affected(attempt: Attempt, timeline: Timeline) -> dict[str, GateTimeline]:
    """Return the gates that the plan goes to, and the gates with a gap in their cover."""
    actions = attempt.plan.actions if attempt.plan is not None else ()
    named = {action.target for action in actions}
    return {
        gate: line
        for gate, line in timeline.gates.items()
        if gate in named or line.longest_gap_s or not line.covered_after
    }


def _tracks(timeline: Timeline) -> TraceTable:
    """Return the times of the actions on each track, and the shortest distance of an asset."""
    columns = (Column("track", 11), Column("rehearsed", tone="quiet"))
    return table(columns, ((name, _track(line)) for name, line in timeline.tracks.items()))


def _track(line: TrackTimeline) -> str:
    times = (
        ("observed", line.observed_s),
        ("ground contact", line.ground_contact_s),
        ("identified", line.identified_s),
        ("warned", line.warned_s),
        ("blocked", line.blocked_s),
    )
    facts = [f"{action} after {seconds:.1f} s" for action, seconds in times if seconds is not None]
    if line.least_distance_m is not None:
        facts.append(f"never nearer than {line.least_distance_m:.1f} m")
    return ", ".join(facts) or "no action"


def checks(attempt: Attempt, rules: Rules, *, with_rest: bool) -> Iterator[TraceSection]:
    """Yield the broken rules with reasons, the most urgent first, then the other rules."""
    findings = attempt.findings
    broken = sorted(
        (item for item in findings if item.broken), key=lambda f: _MOST_URGENT_FIRST[f.priority]
    )
    rest = [item for item in findings if not item.broken]
    mark = (
        Status("✘", f"{len(broken)} broken", "bad")
        if broken
        else Status("✔", "no rule broken", "good")
    )
    note = f"{count(len(findings), 'rule')}, {duration_text(attempt.checks_s)}"
    key = f"checks-{attempt.number}"
    stands = statement("every checked rule holds or does not apply", "quiet")
    block = _findings(broken, rules) if broken else stands
    yield TraceSection(key, "Checks", (block,), step=5, mark=mark, note=note)
    if rest and with_rest:
        held = sum(item.status == "complies" for item in rest)
        yield TraceSection(
            f"{key}-rest",
            "Rules not broken",
            (_findings(rest, rules),),
            step=5,
            note=f"{held} comply, {len(rest) - held} other",
            collapsed=True,
        )


def _findings(findings: list[Finding], rules: Rules) -> TraceTable:
    columns = (
        Column("", 1),
        Column("rule", 7, stress="bold"),
        Column("finding"),
        Column("priority"),
        Column("reason", below=12),
    )
    return table(columns, [_finding(item, rules) for item in findings], gap="  ")


def _finding(finding: Finding, rules: Rules) -> tuple[Span | Status | str, ...]:
    mark, urgency = status_of("finding", finding.status), status_of("priority", finding.priority)
    rule = rules.get(finding.rule_id)
    reason = finding.message if finding.broken else (rule.text if rule else finding.message)
    return (
        Span(mark.glyph, mark.tone),
        finding.rule_id,
        Span(mark.word, mark.tone),
        urgency,
        Span(reason, "" if finding.broken else "quiet"),
    )


def evidence(attempt: Attempt, given: DecisionEvidence) -> TraceSection:
    """Return the telemetry that the checks used about everything in the plan or a finding."""
    by = ", ".join(finding.rule_id for finding in given.deciding) or "no rule"
    against = any(finding.broken for finding in given.deciding)
    stands = "against the plan" if against else "for the plan"
    columns = (Column("name", 11, stress="bold"), Column("telemetry", tone="quiet"))
    facts = (table(columns, given.facts),) if given.facts else ()
    note = f"tick {given.tick}, {given.time_s:.1f} s"
    key = f"evidence-{attempt.number}"
    blocks = (labelled(stands, by), *facts)
    return TraceSection(key, "Telemetry used by the checks", blocks, step=5, note=note)


def verdict(attempt: Attempt, *, over: bool = False) -> TraceSection:
    """Return the judge's opinion on each rule and its feedback; no verdict means hold.

    `over` is True if the mission has finished.
    """
    given, key = attempt.verdict, f"verdict-{attempt.number}"
    if not attempt.judged:
        blocks = (Text(attempt.judge_text, verbatim=True),)
        return TraceSection(key, "Judge", blocks, step=6, mark=_unfinished(over))
    if given is None:
        blocks = (statement(attempt.judge_error or "no reason given", "bad"),)
        mark = status_of("verdict", "none")
        return TraceSection(key, "Judge", blocks, step=6, mark=mark, note="means hold")
    mark = status_of("verdict", given.verdict)
    took = _took(attempt.judge_usage)
    broken = frozenset(finding.rule_id for finding in attempt.findings if finding.broken)
    return TraceSection(key, "Judge", opinions(given, broken), step=6, mark=mark, note=took)


def second_reading(attempt: Attempt, read: OrderReadAgain) -> TraceSection:
    """Return the second reader's reading of an order that planner or judge was unsure about."""
    key, blocks = f"read-again-{attempt.number}", [labelled("by", read.model)]
    if read.error:
        blocks.append(statement(read.error, "warn"))
    else:
        blocks.append(labelled("read as", plain_reading(read.asked)))
    if read.confidence is not None:
        blocks.append(labelled("confidence", f"{read.confidence:.0%}"))
    took = _took(read.usage)
    return TraceSection(key, "Second reader", tuple(blocks), step=6, note=took)


def opinions(given: Verdict, broken: Collection[str] = ()) -> tuple[Block, ...]:
    """Return a verdict's feedback and its opinion on each rule.

    The checks, not the judge, decide which rules are `broken`.
    """
    feedback = (statement(given.feedback),) if given.feedback else ()
    if not given.rules:
        return feedback
    marks = [
        (item.rule_id, status_of("opinion", "broken" if item.rule_id in broken else item.opinion))
        for item in given.rules
    ]
    columns = (Column("", 1), Column("rule", 7, stress="bold"), Column("opinion"))
    rows = [(Span(m.glyph, m.tone), name, Span(m.word, m.tone)) for name, m in marks]
    return (*feedback, table(columns, rows))


def approval(asked: ApprovalRequested) -> TraceSection:
    """Return a request for approval: its obstacles, conditions and alternative readings."""
    blocks: list[Block] = [
        TraceLine((Span(reason, "bad"),), "blocked", "bad") for reason in asked.blocked_by
    ]
    if asked.acknowledge:
        blocks.append(labelled("to be acknowledged", ", ".join(asked.acknowledge), "warn"))
    if asked.needs_override:
        blocks.append(labelled("to be overridden, with a reason", "the judge's Failure", "warn"))
    blocks += [labelled("read as", plain_reading(asked.asked))] if asked.asked else []
    blocks += [labelled("may also mean", plain_reading(words)) for words in asked.readings]
    mark = Status("▶", f"plan {asked.attempt} waits for the operator", "note")
    return TraceSection("approval", "Approval", tuple(blocks), step=7, mark=mark)


def outcome_verdict(given: Verdict | None, error: str) -> tuple[TraceLine, ...]:
    """Return the judge's verdict on an outcome and the rules it finds broken, or its error."""
    mark = status_of("verdict", given.verdict if given else "none")
    line = TraceLine((Span(given.feedback if given else error),), "judge", mark=sign(mark))
    against = [item.rule_id for item in given.rules if item.opinion == "violates"] if given else []
    return (line, labelled("against", ", ".join(against), "bad", depth=1)) if against else (line,)
