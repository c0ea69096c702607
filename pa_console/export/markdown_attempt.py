"""One attempt at a plan as Markdown: prompt, answer, checks, rehearsal, verdict (steps 4 to 6)."""

from collections.abc import Iterator, Mapping

from pa_console.export.markdown_text import fenced, folded, inline, table
from pa_console.schema.finding import Finding, Usage, Verdict
from pa_console.schema.rehearsal import Timeline
from pa_console.schema.rule import PRIORITIES, Rule
from pa_console.session.evidence import Evidence, evidence_of
from pa_console.session.mission_trace import Attempt
from pa_console.session.wording import safety_in_words
from pa_console.tui.words import count


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
