"""One example of every verb, which ends its help and is a call that the verb takes."""

from collections.abc import Mapping

import typer

EXAMPLES = {
    "console": "pa-console console --scenario situation-1-unauthorized",
    "mission": 'pa-console mission "Move the drone to the east gate." --approve auto',
    "serve": "pa-console serve --make-token operator --person ann",
    "replay": "pa-console replay session.jsonl --verify",
    "sessions": "pa-console sessions last --json",
    "doctor": "pa-console doctor --json",
    "export": "pa-console export markdown session.jsonl --mission M1 --out M1.md",
    "export markdown": "pa-console export markdown session.jsonl --mission M1 --out M1.md",
    "export mcap": "pa-console export mcap session.jsonl --out session.mcap",
    "export svg": "pa-console export svg session.jsonl --at approval_requested --out pictures",
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
    "world check": "pa-console world check six.yaml",
    "settings": "pa-console settings show",
    "settings show": "pa-console settings show --json",
    "settings path": "pa-console settings path",
    "settings set": "pa-console settings set theme pa-console-light",
    "settings unset": "pa-console settings unset keys.stop",
    "settings reset": "pa-console settings reset",
    "manual": "pa-console manual rules",
}


def add_examples(app: typer.Typer, examples: Mapping[str, str], above: str = "") -> None:
    """End the help of every verb below `app` with its example, named by the verb's words."""
    for command in app.registered_commands:
        name = command.name or (command.callback.__name__ if command.callback else "")
        command.epilog = _ended(command.epilog, examples.get(f"{above}{name}".strip()))
    for group in app.registered_groups:
        below = group.typer_instance
        if below is not None and group.name:
            words = f"{above}{group.name}"
            group.epilog = _ended(below.info.epilog, examples.get(words))
            add_examples(below, examples, f"{words} ")


def _ended(text: object, example: str | None) -> str:
    """Return a help's end with its example, whose lines no terminal width joins."""
    parts = [text] if isinstance(text, str) else []
    if example is not None:
        parts.append(f"\b\nExample:\n  {example}")
    return "\n\n".join(parts)
