"""`pa-console rules`: list the policy, search it as the retriever does, check a rule file."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.output import JsonOption, RulesOption, errors, out, print_json, warn_of_altered
from pa_console.cli.rules import effect, lint, rule_sets, trace
from pa_console.cli.rules.rule_sets import seal_in_words
from pa_console.policy.authoring.examples import run_example
from pa_console.policy.core_rules import differing_core
from pa_console.policy.retriever import DEFAULT_METHOD, METHODS, Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import existing_data
from pa_console.schema.rule import Rule, approvals_in_words
from pa_console.schema.text import count

BROKEN = 2

app = typer.Typer(
    help="List, search, check, lint, sign, compare, try and trace rules.", no_args_is_help=True
)
app.command("sign")(rule_sets.sign)
app.command("pin")(rule_sets.pin)
app.command("diff")(rule_sets.diff)
app.command("lint")(lint.lint)
app.command("effect")(effect.effect)
app.command("trace")(trace.trace)


def _load(rules: str) -> Rulebook:
    return load_rules(existing_data("rules", rules, "rules.yaml"))


def _how(rule: Rule) -> str:
    return "checked" if rule.decidable else "judged only"


def _tell_approvals(book: Rulebook) -> None:
    """Show the acts that need several people, and those that standing orders may do unasked."""
    if book.unasked:
        told = f"standing orders may have carried out unasked: {', '.join(book.unasked)}"
        out.print(told, markup=False, soft_wrap=True)
    if asked := approvals_in_words(book.approvals):
        out.print(f"people who must approve: {asked}", markup=False, soft_wrap=True)


@app.command("list")
def list_rules(rules: RulesOption = "checkpoint", json: JsonOption = False) -> None:
    """List every rule in force: id, priority, whether it is checked or only judged, text."""
    book = _load(rules)
    if json:
        print_json([rule.model_dump(mode="json") for rule in book.rules])
        return
    title = f"{book.name}: {count(len(book.rules), 'rule')}, {seal_in_words(book.seal)}"
    table = Table("rule", "priority", "how", "text", title=title)
    warn_of_altered(book.name, book.seal)
    for rule in book.rules:
        table.add_row(rule.id, rule.priority, _how(rule), rule.text)
    out.print(table)
    _tell_approvals(book)


@app.command()
def search(
    text: Annotated[str, typer.Argument(help="Words of a mission.")],
    rules: RulesOption = "checkpoint",
    top: Annotated[int, typer.Option("--top", "-k", min=1, help="Number of rules.")] = 3,
    retriever: Annotated[
        str, typer.Option(help=f"How rules are found: {', '.join(METHODS)}.")
    ] = DEFAULT_METHOD,
    json: JsonOption = False,
) -> None:
    """Show what the retriever finds for TEXT: pinned rules first, then the best, with scores."""
    book = _load(rules)
    hits = Retriever(book.rules, retriever).retrieve(text, top)
    if json:
        print_json([hit.model_dump(mode="json") for hit in hits])
        return
    names = sorted({name for hit in hits for name in hit.components})
    table = Table("rule", "score", *names, "why", "text")
    for hit in hits:
        parts = [f"{hit.components.get(name, 0.0):.3f}" for name in names]
        why = "pinned" if hit.pinned else "retrieved"
        table.add_row(hit.rule_id, f"{hit.score:.3f}", *parts, why, book.get(hit.rule_id).text)
    out.print(table)


@app.command()
def check(
    file: Annotated[Path | None, typer.Argument(help="A rule file; default: checkpoint.")] = None,
    json: JsonOption = False,
) -> None:
    """Load a rule file, compile its checks and run every example; exit code 2 if one is wrong.

    A set that was altered since it was signed is wrong too.
    """
    book = _load(str(file) if file is not None else "checkpoint")
    wrong: list[dict[str, str]] = []
    examples = 0
    for rule in book.rules:
        for example in rule.examples:
            examples += 1
            found = run_example(rule, example)
            status = {"complies": "pass", "violates": "fail"}.get(found.status, found.status)
            if status != example.expect:
                wrong.append(
                    {
                        "rule": rule.id,
                        "example": example.name,
                        "expected": example.expect,
                        "got": status,
                        "message": found.message,
                    }
                )
    checked = sum(rule.decidable for rule in book.rules)
    if json:
        print_json({"rules": len(book.rules), "checked": checked, "examples": examples,
                    "wrong": wrong, "seal": book.seal})  # fmt: skip
    else:
        for entry in wrong:
            errors.print(
                f"{entry['rule']}: example {entry['example']!r} should {entry['expected']}, "
                f"got {entry['got']}: {entry['message']}",
                markup=False,
            )
        out.print(
            f"{count(len(book.rules), 'rule')}, {checked} checked, "
            f"{count(examples, 'example')}, {len(wrong)} wrong"
        )
        out.print(f"{book.name}, {seal_in_words(book.seal)}", markup=False, soft_wrap=True)
        _tell_approvals(book)
        warn_of_altered(book.name, book.seal)
        if lacking := differing_core(book):
            out.print(f"the core's own stay in force besides: {', '.join(lacking)}", soft_wrap=True)
    if wrong or book.seal.altered:
        raise typer.Exit(BROKEN)
