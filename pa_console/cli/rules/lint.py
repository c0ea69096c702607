"""`pa-console rules lint`: what is doubtful in a rule file."""

from typing import Annotated

import typer

from pa_console.cli.export.source import ExportBar
from pa_console.cli.output import FAILED, JsonOption, WorldOption, out, print_json
from pa_console.policy.authoring.lint import Searched, lint_rules, search_rules, search_steps
from pa_console.policy.rulebook import load_rules, read_rule_set
from pa_console.resources import existing_data
from pa_console.sim.worlds.world_file import open_world

STYLES = {"error": "red", "warning": "yellow", "note": "dim"}


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
    searched = Searched()
    if states:
        with ExportBar("searching states", search_steps(rule_set, states)) as bar:
            searched = search_rules(document, rule_set, place, states, seed, lambda: bar.advance(1))
        findings = sorted([*findings, *searched.findings], key=lambda f: (f.line, f.kind))
    counts = {name: sum(found.severity == name for found in findings) for name in STYLES}
    if json:
        print_json({"file": str(path), "rules": len(rule_set.rules), "findings": findings,
                    "counts": counts, "searched": searched.words if states else ""})  # fmt: skip
    else:
        for entry in findings:
            out.print(
                f"{path}:{entry.line}: {entry.severity}: {entry.rule}: {entry.kind}: "
                f"{entry.problem}; {entry.remedy}",
                style=STYLES[entry.severity],
                markup=False,
                soft_wrap=True,
            )
        told = ", ".join(f"{name}s {count}" for name, count in counts.items())
        out.print(f"rules: {len(rule_set.rules)}, {told}", markup=False)
        if states:
            out.print(f"searched: {searched.words}", markup=False, soft_wrap=True)
    if counts["error"] or counts["warning"]:
        raise typer.Exit(FAILED)
