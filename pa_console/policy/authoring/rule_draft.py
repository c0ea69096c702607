"""The check of a rule that is being written: parsing, compiling, examples and problems."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import cast

import yaml

from pa_console.policy.authoring.examples import run_example
from pa_console.policy.rule_seal import Plain
from pa_console.policy.rulebook import CompiledRule, ExpressionError, compile_rule
from pa_console.schema.document import Document, DocumentError, FieldPath
from pa_console.schema.rule import Rule, RuleExample

_CEL_PLACE = re.compile(r"\bline (\d+), column (\d+)")
_UNKNOWN = re.compile(r"^unknown (?:name|function) '(\w+)'")
_STATUS = {"complies": "pass", "violates": "fail"}


@dataclass(frozen=True)
class Problem:
    """A problem in a draft; `line` and `column` count from 1, and are 0 if they are unknown."""

    line: int
    column: int
    field: str
    text: str

    def __str__(self) -> str:
        place = f"line {self.line}" if self.line else ""
        place += f", column {self.column}" if self.line and self.column else ""
        return ": ".join(part for part in (place, self.field, self.text) if part)


@dataclass(frozen=True)
class ExampleResult:
    """The result of an example: `got` is pass, fail, not_applicable or error."""

    name: str
    expect: str
    got: str
    message: str = ""

    @property
    def right(self) -> bool:
        """True if the example has its expected result."""
        return self.got == self.expect


@dataclass(frozen=True)
class RuleDraft:
    """The text of one rule; `entry` is None if the rule cannot be in force because of `problem`."""

    text: str
    entry: CompiledRule | None
    problem: Problem | None = None
    examples: tuple[ExampleResult, ...] = ()

    @property
    def wrong(self) -> tuple[ExampleResult, ...]:
        """The examples that do not have their expected result."""
        return tuple(result for result in self.examples if not result.right)


def check_draft(text: str, taken: Collection[str] = ()) -> RuleDraft:
    """Parse `text` as a rule and run its examples; `taken` are the ids of the other rules."""
    try:
        document = Document("rule", text)
        _refuse_unknown(document)
        rule = document.parse(Rule)
        if rule.id in taken:
            raise document.error(("id",), f"{rule.id!r} is another rule's")
    except DocumentError as error:
        return RuleDraft(text, None, _document_problem(error))
    try:
        entry = compile_rule(rule)
    except ExpressionError as error:
        line, column = _place(document, text, error)
        field = ".".join(map(str, error.field))
        return RuleDraft(text, None, Problem(line, column, field, _without_place(error.problem)))
    return RuleDraft(text, entry, None, run_examples(rule))


def run_examples(rule: Rule) -> tuple[ExampleResult, ...]:
    """Run every example of `rule`."""
    return tuple(_run(rule, example) for example in rule.examples)


def _run(rule: Rule, example: RuleExample) -> ExampleResult:
    result = run_example(rule, example)
    got = _STATUS.get(result.status, result.status)
    return ExampleResult(example.name, example.expect, got, result.message)


def _refuse_unknown(document: Document) -> None:
    """Report an unknown field first, because it may be a missing field, misspelled."""
    fields = cast(Plain, document.value) if isinstance(document.value, dict) else {}
    for key in fields:
        if key not in Rule.model_fields:
            names = ", ".join(Rule.model_fields)
            raise document.error((str(key),), f"there is no such field; known: {names}")


def _document_problem(error: DocumentError) -> Problem:
    return Problem(error.line, error.column, error.field, error.problem)


def _place(document: Document, text: str, error: ExpressionError) -> tuple[int, int]:
    """Return the line and column of a compile error in `text`; an unknown column is 0.

    The position within a folded or quoted text of several lines is not known.
    """
    line, node = document.line(error.field), _node(document.root, error.field)
    if not isinstance(node, yaml.ScalarNode):
        return line, 0
    inside = _inside(error.problem, str(node.value))
    if inside is None:
        return line, 0
    row, column = inside
    start = node.start_mark
    if node.style == "|":
        lines = text.split("\n")
        at = next(
            (n for n in range(start.line + 1, len(lines)) if lines[n].strip()), start.line + 1
        )
        indent = len(lines[at]) - len(lines[at].lstrip(" ")) if at < len(lines) else 0
        return start.line + 1 + row, indent + column
    if node.style != ">" and start.line == node.end_mark.line and row == 1:
        return start.line + 1, start.column + (1 if node.style else 0) + column
    return line, 0


def _inside(problem: str, source: str) -> tuple[int, int] | None:
    """Return line and column, from 1, of a problem in the expression `source`; None if unknown."""
    if (match := _CEL_PLACE.search(problem)) is not None:
        return int(match[1]), int(match[2])
    unknown = _UNKNOWN.match(problem)
    at = re.search(rf"\b{unknown[1]}\b", source) if unknown is not None else None
    if at is None:
        return None
    before = source[: at.start()]
    return before.count("\n") + 1, at.start() - (before.rfind("\n") + 1) + 1


def _without_place(problem: str) -> str:
    """Return the problem without its position in the expression; the draft's is shown instead."""
    return re.sub(r": line \d+, column \d+: ", ": ", problem, count=1)


def _node(root: yaml.Node | None, field: FieldPath) -> yaml.Node | None:
    node = root
    for part in field:
        if isinstance(node, yaml.MappingNode):
            node = next((value for key, value in node.value if key.value == part), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int):
            node = node.value[part]
    return node
