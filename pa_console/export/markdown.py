"""One mission's whole trace as a Markdown document, in the order of the paper's eight steps."""

from collections.abc import Iterator, Mapping

from pa_console.export.markdown_attempt import attempt_parts, verdict_parts
from pa_console.export.markdown_text import inline, table
from pa_console.schema.event import SessionStarted
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest, Selection
from pa_console.session.mission_trace import CommandTrace, MissionTrace, Verified
from pa_console.session.reading_words import meant
from pa_console.tui.trace.rounds import Round, rounds


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
                    made.decision.reason or meant(made.decision.asked),
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


def _verified(item: Verified) -> Iterator[str]:
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
