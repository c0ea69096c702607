"""The verbs by name; the module of a verb is imported only when the verb is asked for."""

from collections.abc import Iterator, Mapping
from functools import cache
from pkgutil import resolve_name
from typing import Any, cast

import typer
from typer.core import TyperGroup
from typer.main import get_group

from pa_console.cli.examples import EXAMPLES, add_examples

VERBS = {
    "console": "console:console",
    "mission": "mission:mission",
    "replay": "replay.replay:replay",
    "doctor": "doctor.doctor:doctor",
    "export": "export.export:app",
    "rules": "rules.rules:app",
    "models": "models:app",
    "eval": "evaluate:app",
    "bench": "bench.bench:app",
    "scenarios": "scenarios:app",
    "world": "world:app",
    "train": "train.train:app",
    "settings": "settings:app",
    "manual": "manual:manual",
}
"""Where each verb is below `pa_console.cli`: a function, or the app of a group of verbs."""


@cache
def load_verb(name: str) -> Any:
    """Return the command of a verb, its help ended with its example; KeyError when unknown."""
    found = resolve_name(f"pa_console.cli.{VERBS[name]}")
    alone = typer.Typer(rich_markup_mode=None)
    if isinstance(found, typer.Typer):
        alone.add_typer(found, name=name)
    else:
        alone.command(name)(found)
    add_examples(alone, EXAMPLES)
    return get_group(alone).commands[name]


class _OnDemand(Mapping[str, Any]):
    """The command of each verb, loaded when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        return load_verb(name)

    def __iter__(self) -> Iterator[str]:
        return iter(VERBS)

    def __len__(self) -> int:
        return len(VERBS)

    def __contains__(self, name: object) -> bool:
        return name in VERBS


class Verbs(TyperGroup):
    """The command line as a whole; only its help and whoever asks for them load all verbs."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = cast(Any, _OnDemand())

    def list_commands(self, ctx: object) -> list[str]:  # noqa: ARG002 - the same for every caller
        """Return the names of all verbs, in the order of the help, without loading them."""
        return list(VERBS)
