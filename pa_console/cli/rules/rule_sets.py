"""`pa-console rules sign`, `rules diff`, `rules pin`: rule sets vouched for and compared."""

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from pa_console.cli.output import BAD_INPUT, FAILED, JsonOption, out, print_json
from pa_console.policy.authoring.differences import Change, FieldChange, compare_rules, word_changes
from pa_console.policy.core_rules import shipped_rules
from pa_console.policy.rule_seal import (
    SHIPPED,
    SHIPPED_FILE,
    canonical,
    content_sha256,
    seal_of,
    sign_rules,
    signature_path,
)
from pa_console.policy.rulebook import load_rules, read_rule_set
from pa_console.resources import find_data
from pa_console.schema.rule import SHORT, RulesSeal
from pa_console.signing import load_signer


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
        out.print(f"{path}: {found}", markup=False, soft_wrap=True)
        out.print(
            f"{target}: {'the same' if agrees else 'ANOTHER; rules pin --write makes it agree'}",
            markup=False,
            soft_wrap=True,
        )
    if not agrees:
        raise typer.Exit(BAD_INPUT)


_MARKS = {"same": ("", "", ""), "removed": ("[-", "-]", "red"), "added": ("{+", "+}", "green")}
SetArgument = Annotated[str, typer.Argument(help="A rule file: an installed name or path.")]


def seal_in_words(seal: RulesSeal) -> str:
    """Return version, short hash and standing of a rule set, in words."""
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
    out.print(
        f"{signature_path(path)}: {rule_set.name}, {seal_in_words(seal)}",
        markup=False,
        soft_wrap=True,
    )
    out.print(f"key: {seal.key}", markup=False, soft_wrap=True)


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
            out.print(
                f"{path}: {rule_set.name}, {seal_in_words(seal)}", markup=False, soft_wrap=True
            )
        for change in changes:
            out.print(_change_text(change), soft_wrap=True)
        counts = [
            f"{number} {kind}"
            for kind in ("added", "removed", "changed", "moved")
            if (number := sum(change.kind == kind for change in changes))
        ]
        out.print(", ".join(counts) or "the same rules", markup=False)
    if changes:
        raise typer.Exit(FAILED)


def _change_text(change: Change) -> Text:
    """Return one difference: what it is of, then a line for each field."""
    name = f"{change.part} {change.id}".strip() if change.part != "set" else "the set itself"
    lines = [Text(f"{change.kind}: {name}", style="bold")]
    lines += [Text("  ").append_text(_field_text(field)) for field in change.fields]
    return Text("\n").join(lines)


def _field_text(field: FieldChange) -> Text:
    text = Text(f"{field.field}: ")
    for kind, words in word_changes(_words(field.before), _words(field.after)):
        start, end, style = _MARKS[kind]
        text.append(f"{start}{words}{end}", style)
    return text


def _words(value: object) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else canonical(value)
