"""Steps 1 to 6 of a mission's trace as sections: rules, picture, plan, checks, verdict."""

from collections.abc import Mapping

from textual.content import Content

from pa_console.schema.finding import Finding
from pa_console.schema.rehearsal import GateTimeline, Rehearsal
from pa_console.schema.rule import PRIORITIES, SHORT, Rule
from pa_console.schema.telemetry import Digest, Selection
from pa_console.session.state.mission_trace import Attempt, MissionTrace
from pa_console.tui.status_words import BAD, NOTE, QUIET, Term, term
from pa_console.tui.trace.rows import Row, Section, column, row, text_rows
from pa_console.tui.words import count, duration_text

Rules = Mapping[str, Rule]
MOST_GATES = 12
"""With more gates than this, a rehearsal lists only those that it concerns."""

_MOST_URGENT_FIRST = {priority: rank for rank, priority in enumerate(PRIORITIES)}


def title(text: str, mark: Term | None = None, note: str = "") -> Content:
    """Build a section's title: words, a status sign, and a quiet note."""
    parts: list[tuple[str, str]] = [(text, "bold")]
    if mark is not None:
        parts.append((f"  {mark.glyph} {mark.word}", mark.style))
    if note:
        parts.append((f"  {note}", QUIET))
    return Content.assemble(*parts)


def retrieved_rules(trace: MissionTrace, rules: Rules) -> Section:
    """Step 2: each retrieved rule with its text and every part of its score, and of which set."""
    rows: list[Row] = []
    for hit in trace.hits:
        rule = rules.get(hit.rule_id)
        parts = [("pinned ", NOTE)] if hit.pinned else []
        scores = " ".join(f"{name} {value:.2f}" for name, value in hit.components.items())
        head = ["  ", column(hit.rule_id, 7, "bold"), (f"{hit.score:.2f} ", "$text-primary")]
        rows.append(row(head, *parts, (scores, QUIET)))
        rows.append(row(" " * 4, rule.text if rule else "(not in this rulebook)"))
    under = f", set {trace.rules[:SHORT]}" if trace.rules else ""
    note = f"{len(trace.hits)} by {trace.method}, {duration_text(trace.retrieval_s)}{under}"
    return Section("rules", title("Rules retrieved", note=note), tuple(rows))


def digest(given: Digest) -> Section:
    """Step 3: the picture as the models were given it."""
    cover = "  ".join(f"{gate}×{count}" for gate, count in given.covered.items())
    free = [f"{kind}: {', '.join(names) or 'none'}" for kind, names in given.free.items()]
    sole = [f"{asset} for {gate}" for gate, asset in given.sole_cover.items()]
    facts = [
        ("cover", cover, ""),
        ("uncovered", ", ".join(given.uncovered), BAD),
        ("free", "; ".join(free), ""),
        ("sole cover", ", ".join(sole), ""),
        ("down", ", ".join(given.down), BAD),
        *(("unknown", line, "$text-warning") for line in given.unknown),
        ("low", ", ".join(given.low_battery), "$text-warning"),
        ("weak link", ", ".join(given.degraded_comms), "$text-warning"),
        *(("track", line, "$text-warning") for line in given.tracks),
    ]
    rows = [
        row(["  ", column(name, 10, QUIET)], (text or "none", style if text else QUIET))
        for name, text, style in facts
    ]
    lost = term("gate", "uncovered") if given.uncovered else None
    return Section("digest", title("Picture", lost), tuple(rows))


def selection(given: Selection) -> Section:
    """Step 3: the part of the picture that the prompt speaks of, and why; the rest as numbers."""
    rows: list[Row] = []
    for kind, chosen in (
        ("gates", given.gates), ("tracks", given.tracks), ("assets", given.assets)
    ):  # fmt: skip
        for name, why in chosen.items():
            rows.append(
                row(["  ", column(kind[:-1], 6, QUIET), column(name, 11, "bold")], (why, QUIET))
            )
    left = [count(number, kind[:-1]) for kind, number in given.left_out.items() if number]
    rows.append(row("  ", (f"left out: {', '.join(left) or 'nothing'}", NOTE)))
    picked = (count(len(chosen), kind) for kind, chosen in (
        ("gate", given.gates), ("track", given.tracks), ("asset", given.assets)
    ))  # fmt: skip
    note = f"{', '.join(picked)}; left out {', '.join(left) or 'nothing'}"
    head = title("Shown to the model", note=note)
    return Section("selection", head, tuple(rows), collapsed=True)


def prompt(attempt: Attempt) -> Section:
    """Step 4: the whole prompt, as it was sent."""
    rows = (
        row("  ", ("system", NOTE)),
        *text_rows(attempt.system),
        row("  ", ("user", NOTE)),
        *text_rows(attempt.user),
    )
    note = f"{len(attempt.system) + len(attempt.user)} characters"
    return Section(f"prompt-{attempt.number}", title("Prompt", note=note), rows, collapsed=True)


def plan(attempt: Attempt) -> Section:
    """Step 5: the answer as it streams, then the plan that was read from it."""
    usage, read = attempt.usage, attempt.plan
    if read is None:
        mark = Term("✘", "unreadable", BAD) if attempt.error else term("step", "active")
        rows = list(text_rows(attempt.text))
        if attempt.error:
            rows.append(row("  ", (attempt.error, BAD)))
        return Section(f"plan-{attempt.number}", title("Plan", mark), tuple(rows))
    rows = [row("  ", (read.reason, "italic"))]
    rows += [
        row(
            ["  ", column(f"{number}", 2, QUIET), column(action.agent, 11, "bold")],
            (action.verb, "$text-primary"),
            f" {action.target or ''}",
        )
        for number, action in enumerate(read.actions, start=1)
    ]
    if not read.actions:
        rows.append(row("  ", ("no action: nothing would move", QUIET)))
    spent = f"{count(usage.completion_tokens, 'token')}, {duration_text(usage.seconds)}"
    rows += [row(["  ", column("not met", 11, "$text-warning")], text) for text in attempt.unmet]
    if attempt.doubt:
        rows.append(row(["  ", column("unsure", 11, "$text-warning")], attempt.doubt))
    note = "by the operator" if attempt.author == "operator" else spent
    return Section(f"plan-{attempt.number}", title("Plan", note=note), tuple(rows))


def rehearsal(attempt: Attempt, run: Rehearsal) -> Section:
    """Step 6: what the rehearsed plan did to each gate, asset and track."""
    rows: list[Row] = []
    gates = run.timeline.gates
    shown = gates if len(gates) <= MOST_GATES else _concerned(attempt, run)
    for gate, line in shown.items():
        mark = term("gate", "covered" if line.covered_after else "uncovered")
        gap = f"longest gap {line.longest_gap_s:.0f} s" if line.longest_gap_s else "no gap"
        rows.append(
            row(
                ["  ", column(gate, 11), column(f"{mark.glyph} {mark.word}", 12, mark.style)],
                (gap, QUIET),
            )
        )
    if len(shown) < len(gates):
        rows.append(
            row("  ", (f"{count(len(gates) - len(shown), 'more gate')}: covered, no gap", QUIET))
        )
    for asset, line in run.timeline.assets.items():
        mark = term("reply", "done" if line.finished else "failed")
        facts = [f"{line.travelled_m:.0f} m", f"battery {line.least_battery_pct:.0f} %"]
        facts += [f"entered {zone}" for zone in line.entered_zones]
        facts += ["left the perimeter"] if line.left_perimeter else []
        facts += [line.detail] if line.detail else []
        rows.append(
            row(
                ["  ", column(asset, 11), column(f"{mark.glyph} {mark.word}", 12, mark.style)],
                (", ".join(facts), QUIET),
            )
        )
    lost = [gate for gate, line in run.timeline.gates.items() if not line.covered_after]
    mark = (
        Term("✘", f"loses {', '.join(lost)}", BAD)
        if lost
        else Term("✔", "all gates covered", "$text-success")
    )
    took = f"{run.timeline.duration_s:.0f} s rehearsed in {duration_text(attempt.rehearsal_s)}"
    return Section(f"rehearsal-{attempt.number}", title("Rehearsal", mark, took), tuple(rows))


def _concerned(attempt: Attempt, run: Rehearsal) -> dict[str, GateTimeline]:
    """Return the gates that the plan goes to, and all that are not covered the whole time."""
    actions = attempt.plan.actions if attempt.plan is not None else ()
    named = {action.target for action in actions}
    return {
        gate: line
        for gate, line in run.timeline.gates.items()
        if gate in named or line.longest_gap_s or not line.covered_after
    }


def checks(attempt: Attempt, rules: Rules) -> tuple[Section, ...]:
    """Step 6: broken rules first, with the reason; those that hold are folded away."""
    broken = sorted(
        (f for f in attempt.findings if f.broken), key=lambda f: _MOST_URGENT_FIRST[f.priority]
    )
    rest = [f for f in attempt.findings if not f.broken]
    held = sum(f.status == "complies" for f in rest)
    mark = (
        Term("✘", f"{len(broken)} broken", BAD)
        if broken
        else Term("✔", "no rule broken", "$text-success")
    )
    note = f"{count(len(attempt.findings), 'rule')}, {duration_text(attempt.checks_s)}"
    rows = [item for f in broken for item in _finding(f, rules)]
    if not rows:
        rows = [row("  ", ("every checked rule holds or does not apply", QUIET))]
    name = f"checks-{attempt.number}"
    sections = [Section(name, title("Checks", mark, note), tuple(rows))]
    if rest:
        folded = title("Rules that stand", note=f"{held} comply, {len(rest) - held} other")
        quiet = tuple(item for f in rest for item in _finding(f, rules))
        sections.append(Section(f"{name}-rest", folded, quiet, collapsed=True))
    return tuple(sections)


def _finding(found: Finding, rules: Rules) -> tuple[Row, ...]:
    mark, urgency = term("finding", found.status), term("priority", found.priority)
    lead = ["  ", (f"{mark.glyph} ", mark.style), column(found.rule_id, 7, "bold")]
    head = row(
        lead, (mark.word, mark.style), "  ", (f"{urgency.glyph} {urgency.word}", urgency.style)
    )
    known = rules.get(found.rule_id)
    reason = found.message if found.broken else (known.text if known else found.message)
    return (head, row(" " * 12, (reason, "" if found.broken else QUIET))) if reason else (head,)


def verdict(attempt: Attempt) -> Section:
    """Step 6: the JudgeLLM's opinion per rule and its feedback; no verdict means hold."""
    given = attempt.verdict
    name = f"verdict-{attempt.number}"
    if not attempt.judged:
        return Section(name, title("Judge", term("step", "active")), text_rows(attempt.judge_text))
    if given is None:
        rows = (row("  ", (attempt.judge_error or "no reason given", BAD)),)
        return Section(name, title("Judge", term("verdict", "none"), "means hold"), rows)
    rows = [row("  ", given.feedback)] if given.feedback else []
    for item in given.rules:
        mark = term("opinion", item.opinion)
        rows.append(
            row(
                ["  ", (f"{mark.glyph} ", mark.style), column(item.rule_id, 7, "bold")],
                (mark.word, mark.style),
            )
        )
    took = duration_text(attempt.judge_usage.seconds)
    return Section(name, title("Judge", term("verdict", given.verdict), took), tuple(rows))
