"""The verbs by name; the module of a verb is imported only when the verb is used."""

from functools import cache
from importlib import import_module
from inspect import getdoc
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_group

VERBS = {
    "console": "Open the console: live map, missions, approval, trace and policy browser.",
    "mission": "Run one mission without the screen, or the missions of a situation.",
    "serve": "Serve a session on this machine: as an HTTP API (see /docs), or as the console in a "
    "browser.",
    "mcp": "Connect an agent to a running console over MCP (stdin and stdout); people decide.",
    "replay": "Replay a session log in the console, verify it, simulate it again, or compare it.",
    "sessions": "List the recorded sessions, or show one: missions, outcomes and state of the log.",
    "doctor": "Check this machine for everything that the console needs.",
    "alert": "Send a test alert to every receiver of alerts.",
    "export": "Export a recorded session as Markdown, MCAP, SVG or asciinema cast.",
    "rules": "List, search, check, lint, sign and compare rules, and trace their effects.",
    "keys": "Manage the keys of a site, sign approvals, and put a station in command.",
    "models": "List and download language models.",
    "eval": "Evaluate models and variants of the pipeline on mission sets.",
    "scenarios": "List, show and check the situations of a world.",
    "site": "Run the simulated checkpoint on a message bus, or create the files of a site.",
    "tak": "Show a session on TAK maps (ATAK, WinTAK) as Cursor on Target.",
    "world": "Generate a world, build one from robots, or check one.",
    "settings": "Show, change and reset the settings.",
    "manual": "List the pages of the manual, or show one.",
}
"""The help of each verb, in order, equal to the docstring or help in its module.

A verb is a function or, for a group, `app`, in the module that has the verb's name. The function
has the verb's name, too.
"""
MODULES = {"eval": "evaluate"}
"""The modules of verbs whose own names have another meaning in Python."""
EXAMPLES = {
    "console": "pa-console console --scenario situation-1-unauthorized",
    "mission": 'pa-console mission "Move the drone to the east gate." --approve auto',
    "serve": "pa-console serve --make-token operator --person ann",
    "mcp": "pa-console mcp --join http://127.0.0.1:8766/mcp",
    "replay": "pa-console replay session.jsonl --verify",
    "sessions": "pa-console sessions last --json",
    "doctor": "pa-console doctor --json",
    "alert": "pa-console alert --alert ntfys://ntfy.example/our-site",
    "export": "pa-console export markdown session.jsonl --mission M1 --out M1.md",
    "export markdown": "pa-console export markdown session.jsonl --mission M1 --out M1.md",
    "export mcap": "pa-console export mcap session.jsonl --out session.mcap",
    "export svg": "pa-console export svg session.jsonl --at approval_requested --out screenshots",
    "export cast": "pa-console export cast session.jsonl --speed 8 --out session.cast",
    "rules": "pa-console rules list",
    "rules list": "pa-console rules list --rules my-rules.yaml",
    "rules search": 'pa-console rules search "unknown vehicle at the gate" --top 5',
    "rules check": "pa-console rules check my-rules.yaml",
    "rules lint": "pa-console rules lint my-rules.yaml --world my-world",
    "rules effect": "pa-console rules effect my-rules.yaml results/night --missions paper",
    "rules trace": "pa-console rules trace ROE-07 results/night",
    "rules pin": "pa-console rules pin",
    "rules sign": "pa-console rules sign my-rules.yaml",
    "rules diff": "pa-console rules diff checkpoint my-rules.yaml",
    "keys": "pa-console keys make",
    "keys make": "pa-console keys make ann --passphrase",
    "keys list": "pa-console keys list --json",
    "keys enrol": "pa-console keys enrol rules my-rules.yaml",
    "keys revoke": "pa-console keys revoke ann",
    "keys rotate": "pa-console keys rotate ann",
    "keys sign": "pa-console keys sign approval.json",
    "keys takeover": "pa-console keys takeover south",
    "models": "pa-console models list",
    "models list": "pa-console models list --json",
    "models pull": "pa-console models pull smollm2-135m",
    "eval": "pa-console eval --missions paper --variant full --variant paper --repeat 3",
    "eval report": "pa-console eval report results/night",
    "eval show": "pa-console eval show results/night",
    "scenarios": "pa-console scenarios list",
    "scenarios list": "pa-console scenarios list --world my-world",
    "scenarios show": "pa-console scenarios show situation-2",
    "scenarios check": "pa-console scenarios check my-scenario.yaml",
    "site": "pa-console site --embedded-broker",
    "site init": "pa-console site init my-site --host 192.0.2.7",
    "tak": "pa-console tak --server tcp://127.0.0.1:8087 --replay last --origin 2.0,-30.0",
    "world": "pa-console world generate --gates 6 --out six.yaml",
    "world generate": "pa-console world generate --gates 6 --assets 20 --seed 7 --out six.yaml",
    "world from": "pa-console world from --fleet mavlink:drones.yaml --out site.yaml",
    "world check": "pa-console world check six.yaml",
    "settings": "pa-console settings show",
    "settings show": "pa-console settings show --json",
    "settings path": "pa-console settings path",
    "settings set": "pa-console settings set theme pa-console-light",
    "settings unset": "pa-console settings unset keys.stop",
    "settings reset": "pa-console settings reset",
    "manual": "pa-console manual rules",
}


@cache
def load_verb(name: str) -> Any:
    """Return the command of a verb, with an example at the end of its help."""
    from pa_console.cli.options import with_field_options  # noqa: PLC0415 - not needed for the list

    module = import_module(f".{MODULES.get(name, name)}", __name__)
    verb = getattr(module, "app", None) or getattr(module, name)
    alone = typer.Typer(rich_markup_mode=None)
    if isinstance(verb, typer.Typer):
        alone.add_typer(verb, name=name)
    else:
        alone.command(name)(with_field_options(verb))
    _add_examples(alone)
    command = get_group(alone).commands[name]
    _name_types(command)
    return command


class Verbs(TyperGroup):
    """The group of all verbs, which shows their help and loads a verb when the verb is called."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {
            name: TyperCommand(name, help=line, short_help=line) for name, line in VERBS.items()
        }

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return a verb's name, its command, and the remaining words; raises TyperException."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, load_verb(name) if name is not None else None, rest


def _name_types(command: Any) -> None:
    """Set the placeholder of each option below `command` to TEXT, NUMBER or PATH."""
    for below in getattr(command, "commands", {}).values():
        _name_types(below)
    for option in command.params:
        kind = option.type_descriptor
        if isinstance(option, TyperOption) and not (option.metavar or kind.is_choice):
            number = kind.is_ranged or kind.annotation in (int, float)
            option.metavar = "PATH" if kind.is_path else "NUMBER" if number else "TEXT"


def _add_examples(app: typer.Typer, above: str = "") -> None:
    """Add to the help of every verb below `app` the example of that verb, if it has one.

    `EXAMPLES` maps the words of a verb to its example. The short help of a verb is set to the whole
    first paragraph of its help.
    """
    for command in app.registered_commands:
        name = command.name or (command.callback.__name__ if command.callback else "")
        help_text = command.help or getdoc(command.callback) or ""
        command.short_help = " ".join(help_text.partition("\n\n")[0].split())
        command.epilog = _ended(command.epilog, f"{above}{name}")
    for group in app.registered_groups:
        below = group.typer_instance
        if below is not None and group.name:
            group.epilog = _ended(below.info.epilog, f"{above}{group.name}")
            _add_examples(below, f"{above}{group.name} ")


def _ended(text: object, words: str) -> str:
    """Return `text`, the end of a verb's help, followed by the verb's example, unwrapped."""
    example = [f"\b\nExample:\n  {EXAMPLES[words]}"] if words in EXAMPLES else []
    return "\n\n".join([text, *example] if isinstance(text, str) else example)
