"""`pa-console rules`: rules, listed, searched, checked, signed and compared."""

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
SetArgument = Annotated[str, typer.Argument(help="Rules: an installed name or a file.")]

app = typer.Typer(
    help="List, search, check, lint, sign and compare rules, and trace their effects.",
    no_args_is_help=True,
)


def _load(rules: str) -> Rulebook:
    return load_rules(existing_data("rules", rules, "rules.yaml"))


def _how(rule: Rule) -> str:
    return "checked" if rule.decidable else "judged only"


def _print_approvals(book: Rulebook) -> None:
    """Print what several people must approve, and what standing orders may do without approval."""
    if book.unasked:
        out.print_line(f"standing orders need no approval for: {', '.join(book.unasked)}")
    if required := approvals_in_words(book.approvals):
        out.print_line(f"required approvals: {required}")


def list_rules(rules: RulesOption = "checkpoint", json: JsonOption = False) -> None:
    """List the rules: id, priority, text, and whether a rule is checked or only judged."""
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
    _print_approvals(book)


def search(
    text: Annotated[str, typer.Argument(help="Text of a mission.")],
    rules: RulesOption = "checkpoint",
    top: Annotated[int, typer.Option("--top", "-k", min=1, help="Number of rules.")] = 3,
    retriever: Annotated[
        str, typer.Option(help=f"Search method: {', '.join(METHODS)}.")
    ] = DEFAULT_METHOD,
    json: JsonOption = False,
) -> None:
    """Show the rules that are retrieved for TEXT with their scores, pinned rules first."""
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
            help="Rule file. Default: checkpoint.", autocompletion=completion.rule_files
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Load a rule file, compile its checks and run its examples.

    Exits with 2 if an example fails, or if the file was changed after it was signed.
    """
    book = _load(str(file) if file is not None else "checkpoint")
    wrong: list[dict[str, str]] = []
    examples = 0
    for rule in book.rules:
        for example in rule.examples:
            examples += 1
            finding = run_example(rule, example)
            status = {"complies": "pass", "violates": "fail"}.get(finding.status, finding.status)
            if status != example.expect:
                wrong.append(
                    {
                        "rule": rule.id,
                        "example": example.name,
                        "expected": example.expect,
                        "got": status,
                        "message": finding.message,
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
        _print_approvals(book)
        warn_of_altered(book.name, book.seal)
        if lacking := differing_core(book):
            out.print_line(f"rules of the core that also stay in force: {', '.join(lacking)}")
    if wrong or book.seal.altered:
        raise typer.Exit(BAD_INPUT)


def pin(
    write: Annotated[
        bool, typer.Option("--write", help="Write the hash into the package.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Compare the content hash of the shipped rules with the one pinned in the package.

    For maintainers: after a change of rules/checkpoint.yaml, run this verb with --write. Exits with
    2 if the hashes differ.
    """
    path = find_data("rules", SHIPPED.name, "rules.yaml")
    load_rules(path)
    rule_set = read_rule_set(path)[1]
    content = content_sha256(rule_set)
    target = SHIPPED_FILE
    source = shipped_rules(rule_set).text
    if write:
        target.write_text(source, encoding="utf-8")
    agrees = target.read_text(encoding="utf-8") == source
    if json:
        print_json({"file": str(path), "content_sha256": content, "pinned": agrees})
    else:
        out.print_line(f"{path}: {content}")
        out.print_line(
            f"{target}: {'the same' if agrees else 'DIFFERENT; update it with rules pin --write'}"
        )
    if not agrees:
        raise typer.Exit(BAD_INPUT)


def seal_in_words(seal: RulesSeal) -> str:
    """Return the version, the short hash and the signature of a rule set in words."""
    version = f"version {seal.version}" if seal.version else "no version"
    key = f" {seal.key}" if seal.standing == "unknown key" else ""
    return f"{version}, content {seal.content_sha256[:SHORT]}, {seal.words}{key}"


def sign(
    file: Annotated[Path, typer.Argument(help="Rule file.")], json: JsonOption = False
) -> None:
    """Sign FILE with this machine's key, and write the signature to FILE.sig."""
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
    """Show the differences between the rule sets A and B, rule by rule.

    Texts are compared word by word: [-removed-] {+added+}. Exits with 1 if the sets differ.
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
        out.print(", ".join(counts) or "no differences")
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
    file: Annotated[str, typer.Argument(help="Rules: an installed name or a file.")] = "checkpoint",
    world: WorldOption = "checkpoint",
    states: Annotated[
        int,
        typer.Option(min=0, help="Number of random states to search; 0 skips the search."),
    ] = 400,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random states.")] = 0,
    json: JsonOption = False,
) -> None:
    """Find gaps, duplicates, contradictions and disagreements in a rule file.

    The rules are read, run in the states of their examples and in random states of a small world,
    and searched for with paraphrases. The names of assets and gates come from the world. Exits with
    1 if there is an error or a warning.
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
    counts = {name: sum(finding.severity == name for finding in findings) for name in STYLES}
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
        numbers = ", ".join(f"{name}s {count}" for name, count in counts.items())
        out.print(f"rules: {len(rule_set.rules)}, {numbers}")
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
