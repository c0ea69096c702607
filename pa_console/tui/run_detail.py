"""Everything that is known of one evaluated run, as rows."""

from pa_console.evaluation.record import Opinion, RunRecord
from pa_console.schema.mission import Metrics
from pa_console.schema.mission_set import Expectation
from pa_console.tui.trace.rows import Part, Row, column, row
from pa_console.tui.vocabulary import BAD, NOTE, QUIET, WARN, term
from pa_console.tui.words import count, duration_text

EXPECTED: dict[Expectation, str] = {
    "execute": "to be carried out",
    "trim": "to be carried out in part, the rest refused",
    "refuse": "to be refused: nothing but hold and report may be ordered",
    "either": "may be carried out or refused",
}
_STAGES = (
    ("retrieval", "retrieval_s"), ("picture", "picture_s"), ("prompt", "prompt_s"),
    ("planning", "planning_s"), ("checks", "checks_s"), ("rehearsal", "rehearsal_s"),
    ("judge", "judging_s"), ("readings", "readings_s"), ("decision", "decision_s"),
    ("dispatch", "dispatch_s"), ("execution", "execution_s"), ("outcome", "outcome_s"),
)  # fmt: skip
_LEAD = 9


def run_rows(record: RunRecord) -> list[Row]:
    """Return a run from its command to its latency; what went wrong comes before the rest."""
    strict, ended = _score(record.strict), term("mission", record.status)
    expected: list[Part] = [EXPECTED[record.expect]]
    if record.category:
        expected.append((f"  {record.category}", QUIET))
    rows = [
        row("", (f"{record.mission}  ", "bold"), (f"{record.run}  in {record.world}", QUIET)),
        _field("command", record.command),
        _field("expected", *expected),
        _field("strict", strict, "   hybrid ", _score(record.hybrid), "   ended ",
               (f"{ended.glyph} {ended.word}", ended.style),
               ("  nobody was moved" if record.refused else "", QUIET)),
    ]  # fmt: skip
    if record.reason:
        rows.append(_field("reason", record.reason))
    rows += [
        _field("broken" if index == 0 else "", (f"✘ {breach.rule_id} ", f"bold {BAD}"),
               breach.what, (f"  {breach.at_s:.1f} s after the command", QUIET))
        for index, breach in enumerate(record.broken)
    ]  # fmt: skip
    rows += [
        _field("not true" if index == 0 else "", ("✘ ", BAD), text)
        for index, text in enumerate(record.failed)
    ]
    rows += [
        _field("plan" if index == 0 else "", text)
        for index, text in enumerate(record.plan or ("none",))
    ]
    rows.append(
        _field("judge", "before ", *_opinion(record.judge_plan, record.strict),
               "   after ", *_opinion(record.judge_outcome, record.strict))
    )  # fmt: skip
    if record.obeyed != record.strict:
        rows.append(_field("", f"obeyed before execution, it would have been {_word(record)}"))
    if record.verification is not None:
        seen = term("outcome", record.verification)
        rows.append(_field("telemetry", (f"{seen.glyph} {seen.word}", seen.style)))
    rows.append(_field("answers", *_answers(record)))
    rows += _latency(record.metrics)
    return rows


def _field(name: str, *body: Part) -> Row:
    return row([column(name, _LEAD, QUIET)], *body)


def _score(good: bool | None) -> tuple[str, str]:
    if good is None:
        return "– no verdict", QUIET
    mark = term("score", "success" if good else "failure")
    return f"{mark.glyph} {mark.word}", mark.style


def _word(record: RunRecord) -> str:
    return "a strict success" if record.obeyed else "a strict failure"


def _opinion(given: Opinion | None, strict: bool) -> list[Part]:
    if given is None:
        return [("– not asked", QUIET)]
    mark = term("verdict", given)
    parts: list[Part] = [(f"{mark.glyph} {mark.word}", mark.style)]
    if (given == "Success") != strict:
        parts.append((" ≠ wrong", f"bold {WARN}"))
    return parts


def _answers(record: RunRecord) -> list[Part]:
    parts: list[Part] = [count(record.attempts, "attempt")]
    if not record.valid_json:
        parts.append((", the first answer was no plan", WARN))
    elif not record.first_sound:
        parts.append((", the first plan broke a Critical or High rule", WARN))
    if record.metrics.plans > 1:
        parts.append(f", {record.metrics.plans} plans carried out")
    if record.reused:
        parts.append((f", {record.reused} taken from equal prompts", QUIET))
    usage = record.planner
    if usage.completion_tokens:
        tokens = f"  first answer {usage.prompt_tokens} + {count(usage.completion_tokens, 'token')}"
        parts.append((f"{tokens}, {duration_text(usage.seconds)}", QUIET))
    return parts


def _latency(metrics: Metrics) -> list[Row]:
    """Return the seconds of every stage that took any; execution is in simulated seconds."""
    taken = [(name, getattr(metrics, field)) for name, field in _STAGES]
    parts: list[Part] = [(duration_text(metrics.end_to_end_s), f"bold {NOTE}"), " in all:"]
    for name, seconds in taken:
        if seconds > 0.0:
            simulated = " simulated" if name == "execution" else ""
            parts += [f"  {name} ", (duration_text(seconds) + simulated, NOTE)]
    return [_field("latency", *parts)]
