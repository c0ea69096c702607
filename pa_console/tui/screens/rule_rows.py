"""The rows of a rule, and the parts that the policy browser and the rule editor share."""

import math
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from textual.content import Content

from pa_console.evaluation.rule_trials import SessionCases, Trial
from pa_console.policy.authoring.rule_draft import ExampleResult, RuleDraft
from pa_console.schema.finding import Finding
from pa_console.schema.rule import Ordering, Rule, RuleHit, RulesSeal
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.kept_input import Drafts
from pa_console.tui.rows import Part, WrappedRow, column, fact, row
from pa_console.tui.status_words import BAD, GOOD, NOTE, QUIET, WARN, term
from pa_console.views.rule_trail import RuleUse

_EXPECTED = {"pass": "must hold", "fail": "must be broken", "not_applicable": "must not apply"}
_GOT = {"pass": "holds", "fail": "is broken", "not_applicable": "does not apply"}


def standing_style(seal: RulesSeal) -> str:
    """Return the style for a rule set's standing: the less trusted the set, the more visible."""
    styles = {"altered": "bold reverse $text-error", "unknown key": "$text-warning"}
    return styles.get(seal.standing, NOTE if seal.key else QUIET)


def rule_line(rule: Rule, score: float | None, *, draft: bool) -> Content:
    """Return a rule as one line of the list, with its score and a sign if it has a draft."""
    urgency = term("priority", rule.priority)
    mode = term("rule", "checked" if rule.decidable else "judged")
    return Content.assemble(
        ("" if score is None else f"{score:4.2f} ", NOTE),
        ("✎" if draft else " ", f"bold {NOTE}"),
        column(rule.id, 7, "bold"),
        (f"{urgency.glyph} ", urgency.style),
        (f"{mode.glyph} ", mode.style),
        rule.text,
    )


def rule_rows(rule: Rule, hit: RuleHit | None) -> list[WrappedRow]:
    """Return all facts about one rule, with its expressions at the end."""
    urgency = term("priority", rule.priority)
    mode = term("rule", "checked" if rule.decidable else "judged")
    rows = [
        row(
            "",
            (f"{rule.id}  ", "bold"),
            (f"{urgency.glyph} {urgency.word}  ", urgency.style),
            mode.part,
        ),
        row(""),
        row("", rule.text),
        row(""),
        fact("enforced", _enforcement(rule)),
    ]
    if rule.tags:
        rows.append(fact("tags", ", ".join(rule.tags)))
    if hit is not None:
        parts = "  ".join(f"{name} {value:.3f}" for name, value in hit.components.items())
        rows.append(fact("score", (f"{hit.score:.3f}  ", NOTE), (parts, QUIET)))
    if rule.message:
        rows += [row(""), row("", ("message", f"bold {NOTE}")), row("  ", rule.message.strip())]
    if rule.examples:
        rows += [row(""), row("", (f"examples ({len(rule.examples)})", f"bold {NOTE}"))]
    for example in rule.examples:
        sign = {"pass": "✔ must hold", "fail": "✘ must be broken"}.get(
            example.expect, "– must not apply"
        )
        rows.append(row("  ", (f"{sign}: ", QUIET), example.name))
        rows += [row("      ", f"{agent}: {command}") for agent, command in example.plan]
        if example.given:
            rows.append(row("      given ", (_as_written(example.given), QUIET)))
        rows += [row("      then ", (_as_written(change), QUIET)) for change in example.moments]
    for name, value in (
        ("applies", rule.applies),
        ("check", rule.check),
    ):
        if value:
            rows += [row(""), row("", (name, f"bold {NOTE}")), row("  ", value.strip())]
    for order in rule.order:
        rows += [row(""), row("", (_ordering(order), f"bold {NOTE}"))]
        rows += [row("  ", part.strip()) for part in (order.event, order.other)]
        rows.append(row("  ", (order.message, QUIET)))
    return rows


def _as_written(value: Mapping[str, Any]) -> str:
    """Return a part of an example as it is written in a rule file, on one line."""
    return yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=math.inf).strip()


def _ordering(order: Ordering) -> str:
    """Return an ordering's kind, its subjects and its time limit; its two events follow."""
    limit = f" {order.seconds} s" if isinstance(order.seconds, float) else f" {order.seconds}"
    subjects = f", each {order.each}" if order.each is not None else ""
    return f"order: {order.kind}{limit if order.seconds is not None else ''}{subjects}"


def _enforcement(rule: Rule) -> str:
    if not rule.decidable:
        return "no: only the judge can assess it"
    return "blocks a plan for everyone" if rule.enforced else "a warning to be acknowledged"


def use_rows(uses: Iterable[RuleUse]) -> Iterator[WrappedRow]:
    """Yield the missions of this session in which a rule was retrieved, decided or broken."""
    yield row("")
    yield row("", ("in this session", f"bold {NOTE}"))
    used = False
    for use in reversed(tuple(uses)):
        used = True
        parts: list[Part] = [(f"{use.text}  ", QUIET)]
        if use.hit is not None:
            how = "pinned" if use.hit.pinned else "retrieved"
            parts.append((f"{how} {use.hit.score:.2f}  ", NOTE))
        parts += [(f"prescribed for {track}  ", NOTE) for track in use.prescribed]
        for number, finding in use.decided:
            parts += [f"#{number} ", *_finding(finding), "  "]
        if use.refused:
            parts.append(("refused before it was planned", BAD))
        yield row(["  ", column(use.mission, 7, "bold")], *parts)
    if not used:
        yield row("  ", ("in no mission yet", QUIET))


def draft_line(draft: RuleDraft) -> Part:
    """Return a line that shows whether a rule draft can be put in force."""
    if draft.problem is not None:
        return f"✘ {draft.problem}", BAD
    if draft.entry is not None and not draft.entry.rule.decidable:
        return "✔ can be put in force; only the judge can assess it", GOOD
    if draft.wrong:
        return (
            f"▲ compiles, but {len(draft.wrong)} of {count(len(draft.examples), 'example')} wrong",
            WARN,
        )
    if not draft.examples:
        return "▲ no examples", WARN
    return f"✔ compiles, {count(len(draft.examples), 'example')} right", GOOD


def draft_rows(draft: RuleDraft, trials: Iterable[Trial]) -> Iterator[WrappedRow]:
    """Yield the results of a draft's examples, and its findings on known plans."""
    if draft.examples:
        yield row("", (f"examples ({len(draft.examples)})", f"bold {NOTE}"))
    for result in draft.examples:
        yield _example(result)
    tried = False
    for trial in trials:
        if not tried:
            yield row("")
            yield row("", ("findings on known plans", f"bold {NOTE}"))
            tried = True
        parts: list[Part] = [*_finding(trial.found)]
        if trial.flips and trial.before is not None:
            was = term("finding", trial.before.status)
            parts.append((f"  was: {was.word}", f"bold {WARN}"))
        yield row(["  ", (f"{trial.case.title}: ", QUIET)], *parts)


def _example(result: ExampleResult) -> WrappedRow:
    if result.right:
        return row(["  ", ("✔ ", GOOD)], result.name, (f"  {_EXPECTED[result.expect]}", QUIET))
    got = _GOT.get(result.got, "cannot be decided")
    outcome = f"  {_EXPECTED[result.expect]}, but {got}"
    message = f": {result.message}" if result.message else ""
    return row(["  ", ("✘ ", BAD)], result.name, (outcome + message, BAD))


def _finding(finding: Finding) -> tuple[Part, ...]:
    mark = term("finding", finding.status)
    message = f" {finding.message}" if finding.message else ""
    return mark.part, message


@dataclass
class Workbench:
    """The parts with which a console edits one rule file.

    `closed` is the reason why the file cannot be edited, or ''. `drafts` are unsaved texts by rule
    id, '' for a new rule; they outlive the editor and the console. `saved` is awaited after the
    file was written, so that it is loaded at once. `offered` returns the reason why the rules in
    the file need to be accepted, or '', and `accept` accepts them.
    """

    world: World
    path: Path | None
    closed: str
    seal: Callable[[], RulesSeal]
    missions: Callable[[], Iterable[MissionTrace]]
    busy: Callable[[], str]
    saved: Callable[[], Awaitable[None]]
    offered: Callable[[], str]
    accept: Callable[[], Awaitable[None]]
    cases: SessionCases = field(init=False)
    drafts: Drafts = field(default_factory=Drafts)

    def __post_init__(self) -> None:
        """Create the cases for trials, at first those of an empty session."""
        self.cases = SessionCases(self.world)
