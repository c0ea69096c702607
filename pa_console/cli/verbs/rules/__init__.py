"""`pa-console rules`: list the policy, search it as the retriever does, check a rule file."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from pa_console.cli import completion
from pa_console.cli.options import JsonOption, RulesOption, WorldOption
from pa_console.cli.progress_bars import TransientBar
from pa_console.cli.verbs.rules.recorded import effect, trace
from pa_console.policy.authoring.differences import Change, FieldChange, compare_rules, word_changes
from pa_console.policy.authoring.examples import run_example
from pa_console.policy.authoring.lint import SearchDoubts, lint_rules, search_rules, search_steps
from pa_console.policy.retriever import DEFAULT_METHOD, METHODS, Retriever
from pa_console.policy.rule_seal import (
    SHIPPED,
    SHIPPED_FILE,
    canonical,
    content_sha256,
    seal_of,
    sign_rules,
    signature_path,
)
from pa_console.policy.rulebook import (
    Rulebook,
    differing_core,
    load_rules,
    read_rule_set,
    shipped_rules,
)
from pa_console.resources import existing_data, find_data
from pa_console.schema.rule import SHORT, Rule, RulesSeal, approvals_in_words
from pa_console.schema.text import count
from pa_console.signing import load_signer
from pa_console.sim.worlds.world_file import open_world
from pa_console.terminal.output import BAD_INPUT, FAILED, errors, out, print_json, warn_of_altered

MARKS = {"same": ("", "", ""), "removed": ("[-", "-]", "red"), "added": ("{+", "+}", "green")}
STYLES = {"error": "red", "warning": "yellow", "note": "dim"}
SetArgument = Annotated[str, typer.Argument(help="A rule file: an installed name or path.")]

app = typer.Typer(
    help="List, search, check, lint, sign and compare rules, and trace what they did.",
    no_args_is_help=True,
)


def _load(rules: str) -> Rulebook:
    return load_rules(existing_data("rules", rules, "rules.yaml"))


def _how(rule: Rule) -> str:
    return "checked" if rule.decidable else "judged only"


def _tell_approvals(book: Rulebook) -> None:
    """Print the acts that several people must approve, and those of standing orders unasked."""
    if book.unasked:
        told = f"standing orders may have carried out unasked: {', '.join(book.unasked)}"
        out.print_line(told)
    if asked := approvals_in_words(book.approvals):
        out.print_line(f"people who must approve: {asked}")


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


def check(
    file: Annotated[
        Path | None,
        typer.Argument(
            help="A rule file; default: checkpoint.", autocompletion=completion.rule_files
        ),
    ] = None,
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
                f"got {entry['got']}: {entry['message']}"
            )
        out.print(
            f"{count(len(book.rules), 'rule')}, {checked} checked, "
            f"{count(examples, 'example')}, {len(wrong)} wrong"
        )
        out.print_line(f"{book.name}, {seal_in_words(book.seal)}")
        _tell_approvals(book)
        warn_of_altered(book.name, book.seal)
        if lacking := differing_core(book):
            out.print_line(f"the core's own stay in force besides: {', '.join(lacking)}")
    if wrong or book.seal.altered:
        raise typer.Exit(BAD_INPUT)


def pin(
    write: Annotated[
        bool, typer.Option("--write", help="Write it into the package, beside the shipped file.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Print the content hash of the shipped rule file; exit code 2 if the package pins another.

    For maintainers: after a change of rules/checkpoint.yaml the package must be made to agree.
    """
    path = find_data("rules", SHIPPED.name, "rules.yaml")
    load_rules(path)
    rule_set = read_rule_set(path)[1]
    found = content_sha256(rule_set)
    target = SHIPPED_FILE
    source = shipped_rules(rule_set).text
    if write:
        target.write_text(source, encoding="utf-8")
    agrees = target.read_text(encoding="utf-8") == source
    if json:
        print_json({"file": str(path), "content_sha256": found, "pinned": agrees})
    else:
        out.print_line(f"{path}: {found}")
        out.print_line(
            f"{target}: {'the same' if agrees else 'ANOTHER; rules pin --write makes it agree'}"
        )
    if not agrees:
        raise typer.Exit(BAD_INPUT)


def seal_in_words(seal: RulesSeal) -> str:
    """Return version, short hash and signature of a rule set, in words."""
    version = f"version {seal.version}" if seal.version else "no version"
    key = f" {seal.key}" if seal.standing == "unknown key" else ""
    return f"{version}, content {seal.content_sha256[:SHORT]}, {seal.words}{key}"


def sign(
    file: Annotated[Path, typer.Argument(help="A rule file.")], json: JsonOption = False
) -> None:
    """Sign FILE as it is now with this machine's key: FILE.sig is written beside it."""
    path = find_data("rules", str(file), "rules.yaml")
    load_rules(path)
    _, rule_set = read_rule_set(path)
    sign_rules(path, rule_set, load_signer())
    seal = seal_of(path, rule_set)
    if json:
        print_json({"signature": str(signature_path(path)), "name": rule_set.name, "seal": seal})
        return
    out.print_line(f"{signature_path(path)}: {rule_set.name}, {seal_in_words(seal)}")
    out.print_line(f"key: {seal.key}")


def diff(a: SetArgument, b: SetArgument, json: JsonOption = False) -> None:
    """Show what differs from rule set A to B, rule by rule; exit code 1 if anything does.

    Texts are compared word by word: [-gone-] {+new+}.
    """
    paths = [find_data("rules", name, "rules.yaml") for name in (a, b)]
    sets = [read_rule_set(path)[1] for path in paths]
    seals = [seal_of(path, rule_set) for path, rule_set in zip(paths, sets, strict=True)]
    changes = compare_rules(*sets)
    if json:
        described = [
            {"file": str(path), "name": rule_set.name, "seal": seal}
            for path, rule_set, seal in zip(paths, sets, seals, strict=True)
        ]
        print_json({"equal": not changes, "sets": described, "changes": changes})
    else:
        for path, rule_set, seal in zip(paths, sets, seals, strict=True):
            out.print_line(f"{path}: {rule_set.name}, {seal_in_words(seal)}")
        for change in changes:
            out.print_line(_change_text(change))
        counts = [
            f"{number} {kind}"
            for kind in ("added", "removed", "changed", "moved")
            if (number := sum(change.kind == kind for change in changes))
        ]
        out.print(", ".join(counts) or "the same rules")
    if changes:
        raise typer.Exit(FAILED)


def _change_text(change: Change) -> Text:
    """Return the text of one difference: its subject, then a line for each field."""
    name = f"{change.part} {change.id}".strip() if change.part != "set" else "the set itself"
    lines = [Text(f"{change.kind}: {name}", style="bold")]
    lines += [Text("  ").append_text(_field_text(field)) for field in change.fields]
    return Text("\n").join(lines)


def _field_text(field: FieldChange) -> Text:
    text = Text(f"{field.field}: ")
    for kind, words in word_changes(_words(field.before), _words(field.after)):
        start, end, style = MARKS[kind]
        text.append(f"{start}{words}{end}", style)
    return text


def _words(value: object) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else canonical(value)


def lint(
    file: Annotated[str, typer.Argument(help="A rule file, or an installed name.")] = "checkpoint",
    world: WorldOption = "checkpoint",
    states: Annotated[
        int,
        typer.Option(min=0, help="States that are drawn and searched; 0: the rules are only read."),
    ] = 400,
    seed: Annotated[int, typer.Option(min=0, help="Which states are drawn.")] = 0,
    json: JsonOption = False,
) -> None:
    """Look for gaps, repetitions, contradictions and disagreements in a rule file.

    Rules are read, run in the states of their examples and in drawn ones of a small world, and
    looked for in other words than their own. Exit code 1 if there is more than notes. The world
    says which names are assets and gates.
    """
    path = existing_data("rules", file, "rules.yaml")
    load_rules(path)
    document, rule_set = read_rule_set(path)
    place = open_world(world)[0]
    findings = lint_rules(document, rule_set, place)
    searched = SearchDoubts()
    if states:
        with TransientBar("searching states", search_steps(rule_set, states)) as bar:
            searched = search_rules(document, rule_set, place, states, seed, bar.advance)
        findings = sorted([*findings, *searched.findings], key=lambda f: (f.line, f.kind))
    counts = {name: sum(found.severity == name for found in findings) for name in STYLES}
    if json:
        print_json({"file": str(path), "rules": len(rule_set.rules), "findings": findings,
                    "counts": counts, "searched": searched.words if states else ""})  # fmt: skip
    else:
        for entry in findings:
            out.print_line(
                f"{path}:{entry.line}: {entry.severity}: {entry.rule}: {entry.kind}: "
                f"{entry.problem}; {entry.remedy}",
                style=STYLES[entry.severity],
            )
        told = ", ".join(f"{name}s {count}" for name, count in counts.items())
        out.print(f"rules: {len(rule_set.rules)}, {told}")
        if states:
            out.print_line(f"searched: {searched.words}")
    if counts["error"] or counts["warning"]:
        raise typer.Exit(FAILED)


for _name, _verb in {
    "list": list_rules,
    "search": search,
    "check": check,
    "lint": lint,
    "diff": diff,
    "effect": effect,
    "trace": trace,
    "sign": sign,
    "pin": pin,
}.items():
    app.command(_name)(_verb)
