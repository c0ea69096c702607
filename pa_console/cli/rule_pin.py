"""`pa-console rules pin`: what the package says of the shipped rules, for those who change them."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import BAD_INPUT, JsonOption, out, print_json
from pa_console.policy import shipped_rules
from pa_console.policy.content import content_sha256
from pa_console.policy.rulebook import load_rules, read_rule_set
from pa_console.policy.shipped_source import shipped_source
from pa_console.resources import find_data


def pin(
    write: Annotated[
        bool, typer.Option("--write", help="Write it into the package, beside the shipped file.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Print the content hash of the shipped rule file; exit code 2 if the package pins another.

    For maintainers: after a change of rules/checkpoint.yaml the package must be made to agree.
    """
    path = find_data("rules", shipped_rules.NAME, "rules.yaml")
    load_rules(path)
    rule_set = read_rule_set(path)[1]
    found = content_sha256(rule_set)
    target = Path(shipped_rules.__file__)
    source = shipped_source(rule_set)
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
