"""`pa-console rules lint`: what is doubtful in a rule file."""

from typing import Annotated

import typer

from pa_console.cli.output import FAILED, JsonOption, WorldOption, out, print_json
from pa_console.orchestrator.compose import open_world
from pa_console.policy.lint import lint_rules
from pa_console.policy.rulebook import load_rules, read_rule_set
from pa_console.resources import find_data


def lint(
    file: Annotated[str, typer.Argument(help="A rule file, or an installed name.")] = "checkpoint",
    world: WorldOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Look for gaps, repetitions and disagreements in a rule file; exit code 1 if there are any.

    The world says which names are assets and gates.
    """
    path = find_data("rules", file, "rules.yaml")
    load_rules(path)
    document, rule_set = read_rule_set(path)
    findings = lint_rules(document, rule_set, open_world(world)[0])
    if json:
        print_json({"rules": len(rule_set.rules), "findings": findings})
    else:
        for entry in findings:
            out.print(
                f"{path}:{entry.line}: {entry.rule}: {entry.kind}: {entry.problem}; {entry.remedy}",
                markup=False,
                soft_wrap=True,
            )
        out.print(f"rules: {len(rule_set.rules)}, findings: {len(findings)}", markup=False)
    if findings:
        raise typer.Exit(FAILED)
