"""Steps 2 to 5 of a mission's trace: rules, picture, prompt, plan."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import cast

from pa_console.schema.finding import Usage
from pa_console.schema.rule import SHORT, Rule
from pa_console.schema.telemetry import Digest, Selection
from pa_console.schema.text import count, duration_text
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.views.event_words import safety_in_words
from pa_console.views.status_words import Status, Tone, status_of
from pa_console.views.trace.parts import (
    Block,
    Column,
    Detail,
    Line,
    Section,
    Span,
    Text,
    TraceOptions,
    labelled,
    statement,
    table,
)

Rules = Mapping[str, Rule]
"""The rules of the session by id; a rule that is missing is shown as unknown."""

_LABEL = 10


def retrieved_rules(trace: MissionTrace, rules: Rules, options: TraceOptions) -> Section:
    """Return step 2: each rule with the components of its score and its text, and the rule set.

    Retrieved rules come before pinned ones, which are in every prompt with any score.
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
    return Section("rules", "Rules retrieved", (table(columns, rows),), step=2, note=note)


def pictures(given: Digest, options: TraceOptions, key: str = "") -> Iterator[Section]:
    """Yield step 3: the picture in the prompts; `key` is different for each attempt."""
    yield _digest(given, options, f"digest{key}")
    if given.selection is not None:
        yield _selection(given.selection, f"selection{key}")


def _digest(given: Digest, options: TraceOptions, key: str) -> Section:
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
    return Section(key, "Picture", tuple(lines), step=3, mark=lost)


def _fact(label: str, text: str, tone: Tone = "") -> Line:
    span = Span(text, tone) if text else Span("none", "quiet")
    return Line((span,), label, "quiet", width=_LABEL)


def _selection(given: Selection, key: str) -> Section:
    """Return the part of the picture in the prompt with its reasons; the rest as numbers."""
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
    return Section(key, "Shown to the model", blocks, step=3, note=note, collapsed=True)


def prompt(attempt: Attempt) -> Section:
    """Return step 4: the whole prompt, as it was sent."""
    blocks = (
        Text(attempt.system, "system", verbatim=True),
        Text(attempt.user, "user", verbatim=True),
    )
    note = f"{len(attempt.system) + len(attempt.user)} characters"
    key = f"prompt-{attempt.number}"
    return Section(key, "Prompt", blocks, step=4, note=note, collapsed=True)


def plan(attempt: Attempt) -> Section:
    """Return step 5: the answer while it streams, then the plan that was read from it."""
    usage, read, key = attempt.usage, attempt.plan, f"plan-{attempt.number}"
    if read is None:
        unreadable = Status("✘", "unreadable", "bad")
        mark = unreadable if attempt.error else status_of("step", "active")
        blocks: list[Block] = [Text(attempt.text, verbatim=True)] if attempt.text else []
        blocks += [statement(attempt.error, "bad")] if attempt.error else []
        return Section(key, "Plan", tuple(blocks), step=5, mark=mark)
    blocks = [Line((Span(read.reason, stress="italic"),))]
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
    blocks.append(
        table(columns, actions) if actions else statement("no action: nothing would move", "quiet")
    )
    if attempt.if_halted:
        blocks.append(labelled("if halted", safety_in_words(attempt.if_halted)))
    blocks += [_warning("not met", text) for text in attempt.unmet]
    blocks += [_warning("unsure", attempt.doubt)] if attempt.doubt else []
    spent = f"{count(usage.completion_tokens, 'token')}, {duration_text(usage.seconds)}"
    note = "by the operator" if attempt.author == "operator" else spent
    return Section(key, "Plan", tuple(blocks), step=5, note=note)


def plan_json(attempt: Attempt) -> Section:
    """Return the answer behind the plan as JSON, one action a line."""
    lines = tuple(_json_line(line) for line in _json_lines(attempt.text))
    note = "as the operator wrote it" if attempt.author == "operator" else "as the model wrote it"
    return Section(
        f"answer-{attempt.number}", "Plan as JSON", lines, step=5, note=note, collapsed=True
    )


def _json_lines(text: str) -> list[str]:
    """Return the lines of a JSON object, each field and list item on its own; else `text`."""
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


_JSON_PART = re.compile(
    r'(?P<name>"(?:[^"\\]|\\.)*"(?=\s*:))|(?P<text>"(?:[^"\\]|\\.)*")|(?P<value>[\w.+-]+)|(?P<sign>.)'
)
_JSON_TONES: Mapping[str, Tone] = {"name": "note", "text": "calm", "value": "good", "sign": "quiet"}


def _json_line(line: str) -> Line:
    """Return a line of JSON with a tone each for names, texts, other values and signs."""
    bare = line.lstrip(" ")
    spans = (
        Span(found[0], _JSON_TONES[found.lastgroup or "sign"])
        for found in _JSON_PART.finditer(bare)
    )
    return Line(tuple(spans), depth=(len(line) - len(bare)) // 2)


def _warning(label: str, text: str) -> Line:
    return Line((Span(text),), label, "warn", width=_LABEL + 1)


def answer(key: str, title: str, text: str, usage: Usage, step: int) -> Section:
    """Return a model's answer word for word, with its cost."""
    cost = (
        f"{usage.prompt_tokens} prompt tokens ({usage.cached_tokens} cached), "
        f"{usage.completion_tokens} written, first after {duration_text(usage.first_token_s)}, "
        f"{duration_text(usage.seconds)} in all"
    )
    note = cost if usage.completion_tokens else ""
    blocks = (Text(text, verbatim=True),)
    return Section(key, title, blocks, step=step, note=note, collapsed=True)
