"""One mission's whole trace as a Markdown document, in the order of the paper's eight steps."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape

from pa_console.orders.plain_words import plain_reading
from pa_console.schema.events.event import SessionStarted
from pa_console.schema.finding import Finding, Usage, Verdict
from pa_console.schema.rehearsal import Timeline
from pa_console.schema.rule import PRIORITIES, Rule
from pa_console.schema.telemetry import Digest, Selection
from pa_console.schema.visible_text import visible, visible_line
from pa_console.session.state.mission_trace import Attempt, CommandTrace, MissionTrace, VerifiedPlan
from pa_console.session.state.rule_trail import Evidence, evidence_of
from pa_console.session.wording import safety_in_words
from pa_console.tui.trace.rounds import Round, rounds
from pa_console.tui.words import count

_SPECIAL = re.compile(r"[\\`*\[\]<>#|~&$]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")
_LIST_MARK = re.compile(r"^(\s*)(?:([-+=:])|(\d+)([.)])(?=\s|$))")
_LINK = re.compile(r"(?i)\b(https?|ftp)://|\bwww\.")
_BREAKS = re.compile(r"\r\n|[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]")


def inline(text: str) -> str:
    """Return `text` for one line of Markdown; line breaks in it become `<br>`."""
    return "<br>".join(_line(line) for line in _BREAKS.split(text.strip()))


def _line(text: str) -> str:
    """Escape one line: no emphasis, link, HTML, table cell or list begins in it."""
    text = visible(text.strip())
    linked = _LINK.sub(lambda found: found[0].replace(":", "\0").replace(".", "\1"), text)
    marked = _SPECIAL.sub(r"\\\g<0>", linked).replace("\0", r"\:").replace("\1", r"\.")
    return _LIST_MARK.sub(_escaped_mark, marked)


def _escaped_mark(found: re.Match[str]) -> str:
    return f"{found[1]}\\{found[2]}" if found[2] else f"{found[1]}{found[3]}\\{found[4]}"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; `rows` are plain values, escaped here, None and empty ones as a dash."""
    lines = [heads, ["---"] * len(heads)]
    lines += [[inline(str(cell)) if cell not in (None, "") else "–" for cell in r] for r in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def fenced(text: str, language: str = "text") -> str:
    """Return `text` as a code block whose fence is longer than any run of backticks in it."""
    runs = [len(run) for run in re.findall(r"`+", text)]
    fence = "`" * max([3, *(length + 1 for length in runs)])
    body = "\n".join(visible(line) for line in _BREAKS.split(text))
    return f"{fence}{language}\n{body}\n{fence}"


def folded(summary: str, body: str) -> str:
    """Return `body` folded away under `summary`, a plain text."""
    return f"<details>\n<summary>{escape(visible_line(summary))}</summary>\n\n{body}\n\n</details>"


def attempt_parts(attempt: Attempt, rules: Mapping[str, Rule]) -> Iterator[str]:
    """Yield the attempt's paragraphs, tables and folded texts, in the order of the steps."""
    phase = f" ({inline(attempt.phase)})" if attempt.phase else ""
    yield f"## Attempt {attempt.number} by the {attempt.author}{phase}{attempt.aside}"
    if attempt.system or attempt.user:
        size = len(attempt.system) + len(attempt.user)
        texts = (("System:", attempt.system), ("User:", attempt.user))
        body = "\n\n".join(f"{name}\n\n{fenced(text)}" for name, text in texts if text)
        yield folded(f"Prompt, {size} characters", body)
    yield from _plan(attempt)
    if attempt.findings:
        yield from _checks(attempt, rules)
    evidence = evidence_of(attempt)
    if evidence is not None:
        yield from _evidence(evidence)
    if attempt.rehearsal is not None:
        yield from _rehearsal(attempt.rehearsal.timeline, attempt.rehearsal_s)
    if attempt.judged or attempt.judge_text:
        yield "### Verdict"
        yield from verdict_parts(attempt.verdict, attempt.judge_error)
        if attempt.judge_text:
            yield folded("The judge's answer", fenced(attempt.judge_text))
        yield _spent(attempt.judge_usage)
    if attempt.repair:
        yield "### Sent back to the planner"
        yield table(("because",), [(reason,) for reason in attempt.repair])


def _plan(attempt: Attempt) -> Iterator[str]:
    yield "### Plan"
    if attempt.plan is None:
        yield f"**No plan could be read:** {inline(attempt.error or 'no answer is recorded')}"
    else:
        yield inline(attempt.plan.reason)
        actions = enumerate(attempt.plan.actions, start=1)
        rows = [(n, act.agent, act.verb, act.target) for n, act in actions]
        yield table(("#", "asset", "command", "target"), rows) if rows else "No action."
        if attempt.if_halted:
            yield f"If halted: {inline(safety_in_words(attempt.if_halted))}."
        if attempt.unmet:
            yield table(("not met",), [(text,) for text in attempt.unmet])
        if attempt.doubt:
            yield f"**Unsure**: {inline(attempt.doubt)}"
    if attempt.text:
        yield folded(f"The {attempt.author}'s answer", fenced(attempt.text))
    if attempt.author == "planner":
        yield _spent(attempt.usage)


def _spent(usage: Usage) -> str:
    return (
        f"{usage.prompt_tokens} prompt tokens ({usage.cached_tokens} cached), "
        f"{usage.completion_tokens} written, first after {usage.first_token_s:.2f} s, "
        f"{usage.seconds:.2f} s in all."
    )


def _checks(attempt: Attempt, rules: Mapping[str, Rule]) -> Iterator[str]:
    """Yield the broken rules, worst first, and the others folded away."""
    broken = [found for found in attempt.findings if found.broken]
    broken.sort(key=lambda found: PRIORITIES.index(found.priority))
    rest = [found for found in attempt.findings if not found.broken]
    yield "### Checks"
    checked = count(len(attempt.findings), "rule")
    yield f"{len(broken)} of {checked} broken, in {attempt.checks_s:.3f} s."
    if broken:
        yield _findings(broken, rules)
    if rest:
        yield folded(f"{count(len(rest), 'rule')} not broken", _findings(rest, rules))


def _findings(findings: list[Finding], rules: Mapping[str, Rule]) -> str:
    rows = [
        (
            found.rule_id,
            found.priority,
            found.status.replace("_", " "),
            found.message,
            rules[found.rule_id].text if found.rule_id in rules else "",
        )
        for found in findings
    ]
    return table(("rule", "priority", "finding", "reason", "text"), rows)


def _evidence(evidence: Evidence) -> Iterator[str]:
    """Yield the telemetry that the checks were given of whatever plan and findings name."""
    yield "### Telemetry that it was decided by"
    by = ", ".join(found.rule_id for found in evidence.deciding) or "no rule"
    stands = "against it" if any(found.broken for found in evidence.deciding) else "for it"
    yield f"The picture of tick {evidence.tick}, {evidence.time_s:.1f} s; {stands}: {inline(by)}."
    if evidence.facts:
        yield table(("name", "telemetry"), evidence.facts)


def _rehearsal(timeline: Timeline, seconds: float) -> Iterator[str]:
    yield "### Rehearsal"
    yield f"{timeline.duration_s:.0f} s rehearsed in {seconds:.2f} s."
    gates = timeline.gates.items()
    yield table(
        ("gate", "covered before", "covered after", "longest gap"),
        [
            (name, _yes(g.covered_before), _yes(g.covered_after), f"{g.longest_gap_s:.0f} s")
            for name, g in gates
        ],
    )
    if timeline.assets:
        heads = ("asset", "finished", "travelled", "least battery", "entered", "left perimeter")
        rows = [
            (
                name,
                _yes(a.finished) + (f": {a.detail}" if a.detail else ""),
                f"{a.travelled_m:.0f} m",
                f"{a.least_battery_pct:.0f} %",
                ", ".join(a.entered_zones),
                _yes(a.left_perimeter),
            )
            for name, a in timeline.assets.items()
        ]
        yield table(heads, rows)
    if timeline.tracks:
        heads = ("track", "observed", "ground contact", "identified", "warned", "blocked", "least")
        rows = [
            (
                name,
                *map(
                    _at,
                    (t.observed_s, t.ground_contact_s, t.identified_s, t.warned_s, t.blocked_s),
                ),
                "" if t.least_distance_m is None else f"{t.least_distance_m:.1f} m",
            )
            for name, t in timeline.tracks.items()
        ]
        yield table(heads, rows)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _at(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:.1f} s"


def verdict_parts(verdict: Verdict | None, error: str) -> Iterator[str]:
    """Yield a judge's verdict with its feedback and opinions, or why there is none."""
    if verdict is None:
        yield f"**No verdict**, which means hold: {inline(error or 'no reason given')}"
        return
    yield f"**{verdict.verdict}**: {inline(verdict.feedback or 'no feedback')}"
    if verdict.rules:
        rows = [(item.rule_id, item.opinion) for item in verdict.rules]
        yield table(("rule", "opinion"), rows)


def mission_document(
    trace: MissionTrace,
    started: SessionStarted,
    rules: Mapping[str, Rule],
    notes: tuple[str, ...] = (),
) -> str:
    """Return the document; `notes` say what the reader should know of the log or the rules."""
    parts = [
        f"# Mission {inline(trace.mission.id)}",
        f"> {inline(trace.mission.said)}",
        *([f"Read as: {inline(trace.mission.text)}"] if trace.mission.typed else []),
        *(f"**Note:** {inline(note)}" for note in notes),
        *_outcome(trace),
        _pinned(trace, started),
        *_workflow(trace),
        *_retrieved(trace, rules),
    ]
    shown: Digest | None = None
    every = rounds(trace)
    if trace.digest is not None and not trace.attempts:
        parts += _picture(trace.digest)
    for given in every:
        if len(every) > 1:
            parts.append(f"## Plan {given.number + 1} of {len(every)}")
        for attempt in given.attempts:
            if attempt.digest is not None and attempt.digest != shown:
                shown = attempt.digest
                parts += _picture(shown)
            parts += attempt_parts(attempt, rules)
        parts += _carried_out(given)
    if trace.unasked_verdict is not None or trace.unasked_error:
        parts.append("## Judge on the outcome")
        parts += verdict_parts(trace.unasked_verdict, trace.unasked_error)
    parts += _report(trace)
    return "\n\n".join(parts) + "\n"


def _outcome(trace: MissionTrace) -> Iterator[str]:
    if trace.status is None:
        yield f"**Not finished:** the log ends at the step {inline(trace.stage)}."
    else:
        yield f"**{inline(trace.status)}**: {inline(trace.reason or 'no reason given')}"
    if trace.approval is not None:
        asked = trace.approval
        rows = [("blocked by", reason) for reason in asked.blocked_by]
        rows += [("to be acknowledged", rule_id) for rule_id in asked.acknowledge]
        rows += [("to be overridden", "the judge")] * asked.needs_override
        yield f"Attempt {asked.attempt} waits for the operator's decision."
        if rows:
            yield table(("what", "value"), rows)


def _pinned(trace: MissionTrace, started: SessionStarted) -> str:
    """What the mission was given by and ran with, so that it can be found and run again."""
    mission = trace.mission
    rows = [
        ("given", f"{mission.created:%Y-%m-%d %H:%M:%S} UTC by {mission.source}"),
        ("alarm", mission.alarm),
        ("about", mission.subject),
        ("gate", mission.gate),
        ("session", started.session),
        ("world", f"{started.world} {started.world_sha256[:12]}"),
        ("rules", f"{started.rules} {started.rules_sha256[:12]}"),
        ("scenario", started.scenario),
        ("model", f"{started.model} {started.model_sha256[:12]}"),
        ("sampler", started.sampler),
        ("seed", started.seed),
        ("version", started.version),
    ]
    return table(("what", "value"), [row for row in rows if row[1] not in (None, "")])


def _workflow(trace: MissionTrace) -> Iterator[str]:
    if trace.workflow:
        yield "## Workflow"
        rows = [
            (
                move.rule_id,
                move.track,
                move.phases[move.phase] if 0 <= move.phase < len(move.phases) else "over",
                move.command,
                ", ".join(move.skipped),
                move.outcome,
            )
            for move in trace.workflow
        ]
        yield table(("rule", "track", "phase", "command", "skipped", "outcome"), rows)


def _retrieved(trace: MissionTrace, rules: Mapping[str, Rule]) -> Iterator[str]:
    if trace.hits:
        yield "## Rules retrieved"
        yield f"By the method {inline(trace.method)}, in {trace.retrieval_s:.3f} s."
        rows = [
            (
                hit.rule_id,
                f"{hit.score:.3f}",
                ", ".join(f"{name} {value:.3f}" for name, value in hit.components.items()),
                "yes" if hit.pinned else "",
                rules[hit.rule_id].text if hit.rule_id in rules else "",
            )
            for hit in trace.hits
        ]
        yield table(("rule", "score", "components", "pinned", "text"), rows)


def _picture(digest: Digest) -> Iterator[str]:
    yield "## Picture"
    rows = [
        ("covered", ", ".join(f"{gate} by {n}" for gate, n in digest.covered.items())),
        ("uncovered", ", ".join(digest.uncovered)),
        *((f"free {kind}", ", ".join(names)) for kind, names in digest.free.items()),
        ("sole cover", ", ".join(f"{a} for {gate}" for gate, a in digest.sole_cover.items())),
        *((f"post of {asset}", post) for asset, post in digest.posts.items()),
        ("down", ", ".join(digest.down)),
        *(("unknown", line) for line in digest.unknown),
        ("low battery", ", ".join(digest.low_battery)),
        ("weak link", ", ".join(digest.degraded_comms)),
        *(("track", line) for line in digest.tracks),
    ]
    yield table(("what", "value"), rows)
    if digest.selection is not None:
        yield from _selection(digest.selection)


def _selection(chosen: Selection) -> Iterator[str]:
    yield "### Shown to the model"
    kinds = (("gate", chosen.gates), ("track", chosen.tracks), ("asset", chosen.assets))
    rows = [(kind, name, why) for kind, names in kinds for name, why in names.items()]
    rows += [(kind, f"{n} left out", "") for kind, n in chosen.left_out.items() if n]
    yield table(("kind", "name", "why"), rows)


def _carried_out(given: Round) -> Iterator[str]:
    """Yield what was decided on a plan, and what came of it."""
    if given.decisions or given.voided:
        yield "## Decision"
    if given.decisions:
        yield table(
            ("attempt", "decision", "by", "accepted", "reason", "override", "acknowledged"),
            [
                (
                    made.attempt,
                    made.decision.kind,
                    made.decision.by,
                    "yes" if made.accepted else f"no: {made.detail}",
                    made.decision.reason or plain_reading(made.decision.asked),
                    "the judge" if made.decision.override_judge else "",
                    ", ".join(made.decision.acknowledged),
                )
                for made in given.decisions
            ],
        )
    if given.voided:
        yield f"**Void:** {inline(given.voided)}"
    if given.commands:
        yield "## Commands"
        heads = ("id", "asset", "command", "replies (tick)", "sent again")
        yield table(heads, [_command(sent) for sent in given.commands])
    for halt in given.halts:
        yield "## Halted"
        reasons = [("because", reason) for reason in halt.reasons]
        yield table(("what", "value"), reasons + [("made safe", told) for told in halt.safe_state])
    for verified in given.verified:
        yield from _verified(verified)


def _command(sent: CommandTrace) -> tuple[object, ...]:
    command = sent.command
    replies = "\n".join(
        f"{reply.status} ({reply.tick}) {reply.detail}".rstrip() for reply in sent.replies
    )
    words = f"{command.verb} {command.target or ''}".rstrip()
    return command.command_id, command.agent, words, replies or "no reply", sent.resent or ""


def _verified(item: VerifiedPlan) -> Iterator[str]:
    told = item.verification
    yield "## Verification"
    reason = f": {inline(told.reason)}" if told.reason else ""
    yield f"**{told.outcome}** as of {told.as_of_s:.1f} s{reason}"
    rows = [(done.agent, done.command, done.outcome, done.reason) for done in told.actions]
    rows += [("", gate, "lost", "") for gate in told.gates_lost]
    rows += [("", gate, "unknown", "") for gate in told.gates_unknown]
    if rows:
        yield table(("asset", "command or gate", "outcome", "reason"), rows)
    if item.judged:
        yield "### Judge on the outcome"
        yield from verdict_parts(item.verdict, item.error)


def _report(trace: MissionTrace) -> Iterator[str]:
    if trace.report:
        yield "## Report"
        yield inline(trace.report)
    if trace.metrics is not None:
        yield "## Measured"
        values = trace.metrics.model_dump().items()
        yield table(
            ("what", "value"),
            [
                (name.removesuffix("_s"), f"{value:.3f} s" if name.endswith("_s") else value)
                for name, value in values
            ],
        )
