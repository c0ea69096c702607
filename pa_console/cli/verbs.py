"""The verbs by name; the module of a verb is imported only when the verb is asked for."""

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pkgutil import resolve_name
from typing import Any, NamedTuple, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group

from pa_console.cli.examples import EXAMPLES, add_examples


class Verb(NamedTuple):
    """Where a verb is below `pa_console.cli`, a function or the app of a group, and its help."""

    place: str
    line: str


VERBS = {
    "console": Verb(
        "console.console:console",
        "Open the console: live checkpoint, policy browser, missions, trace and approval.",
    ),
    "mission": Verb(
        "mission.mission:mission",
        "Plan, check, rehearse, judge, decide, execute and verify one mission, or a situation's.",
    ),
    "serve": Verb(
        "serve.serve:serve",
        "Serve a session on loopback: an HTTP interface (see /docs), or the console in a browser.",
    ),
    "replay": Verb(
        "replay.replay:replay",
        "Play LOG back in the console, verify it, run it again, or compare it with another one.",
    ),
    "sessions": Verb(
        "sessions:sessions",
        "List the recorded sessions: what each was about, how it ended, whether its log is sound.",
    ),
    "doctor": Verb(
        "doctor.doctor:doctor",
        "Look for everything that the console needs; exit code 0 when nothing is missing.",
    ),
    "export": Verb(
        "export.export:app", "Write a recorded session as Markdown, MCAP, SVG or asciinema cast."
    ),
    "rules": Verb(
        "rules.rules:app", "List, search, check, lint, sign, compare, try and trace rules."
    ),
    "keys": Verb(
        "keys.keys:app",
        "Make, list, enrol, revoke and rotate the keys of a site; sign; put a station in command.",
    ),
    "models": Verb("models:app", "List and pull language models."),
    "eval": Verb(
        "evaluate.evaluate:app",
        "Run mission sets against models and variants of the pipeline; more below.",
    ),
    "scenarios": Verb("scenarios:app", "List, show and check the situations of a world."),
    "site": Verb(
        "site.site:app", "Run the simulated checkpoint as a service on a message bus; more below."
    ),
    "tak": Verb(
        "tak.tak:tak",
        "Show a session on TAK maps (ATAK, WinTAK) as Cursor on Target; nothing is taken from "
        "there.",
    ),
    "world": Verb("world:app", "Generate a checkpoint world, or check one."),
    "settings": Verb("settings:app", "Show, change and reset the settings."),
    "manual": Verb("manual:manual", "Read the manual: list its pages, or show one of them."),
}
"""The verbs in the order of the help; each says the same of itself."""


@cache
def load_verb(name: str) -> Any:
    """Return the command of a verb, its help ended with its example; KeyError when unknown."""
    found = resolve_name(f"pa_console.cli.{VERBS[name].place}")
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
    """The command line as a whole; a verb is loaded when it is run, or asked for its help."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = cast(Any, _OnDemand())

    def list_commands(self, ctx: object) -> list[str]:  # noqa: ARG002 - the same for every caller
        """Return the names of all verbs, in the order of the help, without loading them."""
        return list(VERBS)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the line of each verb into the help."""
        with self._unloaded():
            super().format_commands(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Return the verbs and options that begin so, for the shell's completion."""
        with self._unloaded():
            return super().shell_complete(ctx, incomplete)

    @contextmanager
    def _unloaded(self) -> Generator[None]:
        """Let each verb be known by its line alone."""
        loading = self.commands
        self.commands = {name: TyperCommand(name, help=verb.line) for name, verb in VERBS.items()}
        try:
            yield
        finally:
            self.commands = loading
