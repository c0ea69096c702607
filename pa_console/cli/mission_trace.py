"""Prints the trace of a finished mission: what was retrieved, planned, checked, judged and done."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from pa_console.schema.finding import Verdict
from pa_console.session.state.mission_trace import Attempt, MissionTrace
from pa_console.session.state.rule_trail import evidence_of
from pa_console.session.wording import safety_in_words

STYLES = {"verified": "bold green", "unverified": "bold yellow"}


def print_trace(console: Console, trace: MissionTrace) -> None:
    """Print `trace` in the order of the eight steps."""
    _print_mission(console, trace)
    if trace.hits:
        _print_rules(console, trace)
    for attempt in trace.attempts:
        _print_attempt(console, attempt)
    if trace.decision is not None:
        decision = trace.decision
        why = f", {decision.reason}" if decision.reason else ""
        console.print(f"decision: {decision.kind}{why}", markup=False)
    for command in trace.commands.values():
        replies = " > ".join(reply.status for reply in command.replies) or "no reply"
        detail = command.replies[-1].detail if command.replies else ""
        text = f"  {command.command.agent} {command.command.verb} {command.command.target or ''}"
        console.print(f"{text.rstrip()}: {replies} {detail}".rstrip(), markup=False)
    if trace.report:
        console.print(trace.report, markup=False)
    if trace.outcome_verdict is not None or trace.outcome_error:
        console.print(f"outcome, by the judge: {_verdict(trace.outcome_verdict)}", markup=False)
    if trace.metrics is not None:
        seconds = trace.metrics
        console.print(
            f"seconds: planning {seconds.planning_s:.2f}, checks {seconds.checks_s:.3f}, "
            f"rehearsal {seconds.rehearsal_s:.2f}, judging {seconds.judging_s:.2f}, "
            f"execution {seconds.execution_s:.1f} (simulated)"
        )
    style = STYLES.get(trace.status or "", "bold red")
    console.print(Text(f"{trace.status}: {trace.reason}", style=style))


def print_proposal(console: Console, trace: MissionTrace, number: int) -> None:
    """Print the rules and attempt `number` of a mission that waits for approval."""
    _print_mission(console, trace)
    if trace.hits:
        _print_rules(console, trace)
    attempt = trace.find(number)
    if attempt is not None:
        _print_attempt(console, attempt)


def _print_mission(console: Console, trace: MissionTrace) -> None:
    mission = trace.mission
    console.print(f"\n{mission.id}  {mission.said}", style="bold", markup=False)
    if mission.typed:
        console.print(f"read as: {mission.text}", markup=False)


def _print_rules(console: Console, trace: MissionTrace) -> None:
    table = Table("rule", "score", "components", "", title=f"rules retrieved ({trace.method})")
    for hit in trace.hits:
        parts = ", ".join(f"{name} {value:.3f}" for name, value in hit.components.items())
        table.add_row(hit.rule_id, f"{hit.score:.3f}", parts, "pinned" if hit.pinned else "")
    console.print(table)


def _print_attempt(console: Console, attempt: Attempt) -> None:
    console.print(f"attempt {attempt.number} by the {attempt.author}{attempt.aside}", style="bold")
    if attempt.plan is None:
        console.print(f"  no plan: {attempt.error or attempt.text}", markup=False)
    else:
        console.print(f"  {attempt.plan.reason}", style="italic", markup=False)
        for action in attempt.plan.actions:
            console.print(f"  {action.agent}  {action.command}", markup=False)
        if attempt.if_halted:
            console.print(f"  if halted: {safety_in_words(attempt.if_halted)}", markup=False)
        for text in attempt.unmet:
            console.print(f"  not met: {text}", style="yellow", markup=False)
        if attempt.doubt:
            console.print(f"  unsure: {attempt.doubt}", style="yellow", markup=False)
    broken = [finding for finding in attempt.findings if finding.broken]
    for finding in broken:
        style = "red" if finding.blocking else "yellow"
        console.print(
            f"  ✗ {finding.rule_id} ({finding.priority}): {finding.message}",
            style=style,
            markup=False,
        )
    if attempt.findings:
        console.print(f"  {len(attempt.findings) - len(broken)} of {len(attempt.findings)} "
                      "rules not broken")  # fmt: skip
    evidence = evidence_of(attempt)
    if evidence is not None:
        at = f"tick {evidence.tick}, {evidence.time_s:.1f} s"
        console.print(f"  decided by the telemetry of {at}:", markup=False)
        for name, told in evidence.facts:
            console.print(f"    {name}: {told}", markup=False, soft_wrap=True)
    if attempt.judged:
        text = _verdict(attempt.verdict) if attempt.verdict else attempt.judge_error
        console.print(f"  judge: {text}", markup=False)


def _verdict(verdict: Verdict | None) -> str:
    if verdict is None:
        return "no verdict"
    against = [opinion.rule_id for opinion in verdict.rules if opinion.opinion == "violates"]
    objections = f", against {', '.join(against)}" if against else ""
    return f"{verdict.verdict}{objections}. {verdict.feedback}"
