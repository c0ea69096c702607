"""The user's settings, as defaults of the verbs' options and as one object."""

from collections.abc import Sequence
from typing import Any, cast

import typer

from pa_console.settings.sources import LoadedSettings, load_settings

WITHOUT = ("settings", "doctor")
"""The verbs that must work with an invalid settings file, because they repair it."""
OBSERVED = ("traces", "metrics_port", "tak", "tak_origin", "tak_contacts")
"""The options of a session that concern its observers."""


def read_assignments(words: Sequence[str]) -> dict[str, object]:
    """Return the values in `--set NAME=VALUE` by name; raises ValueError for a word without `=`."""
    given: dict[str, object] = {}
    for word in words:
        name, sign, value = word.partition("=")
        if not sign:
            raise ValueError(f"--set {word}: expected NAME=VALUE; see 'pa-console settings show'")
        if name.startswith("keys."):
            cast(dict[str, str], given.setdefault("keys", {}))[name.removeprefix("keys.")] = value
        else:
            given[name.replace("-", "_")] = value
    return given


def set_defaults(context: typer.Context, words: Sequence[str]) -> None:
    """Make the settings the defaults of every verb below `context`; `--set` overrides the file.

    Raises DocumentError if a setting is not valid.
    """
    given = read_assignments(words)
    if context.invoked_subcommand not in WITHOUT:
        loaded = load_settings(given)
        loaded.export()
        context.default_map = _defaults(loaded)
        context.obj = loaded


def given_words(context: typer.Context) -> list[str]:
    """Return the values of `--set` as they were typed."""
    return list(context.find_root().params.get("assignments") or ())


def settings_of(context: typer.Context, *names: str) -> LoadedSettings:
    """Return the settings, overridden by the typed options among `names`."""
    typed = {
        name: context.params[name]
        for name in names
        if (source := context.get_parameter_source(name)) and source.name == "COMMANDLINE"
    }
    loaded = context.find_root().obj
    return (loaded if isinstance(loaded, LoadedSettings) else load_settings()).with_options(typed)


def _defaults(loaded: LoadedSettings) -> dict[str, Any]:
    """Return the settings as default values, by verb and parameter."""
    values = loaded.values
    session = {
        "world": values.world,
        "rules": values.rules,
        **({"model": values.model} if values.model else {}),
        **{name: getattr(values, name) for name in ("witness", "require_sandbox", *OBSERVED)},
    }
    tls = {
        "tls_cert": values.tak_certificate,
        "tls_key": values.tak_key,
        "tls_ca": values.tak_authority,
    }
    return {
        "console": {**session, "alarms": values.alarms, "mouse": values.mouse},
        "mission": session,
        "serve": {**session, "alarms": values.alarms},
        "replay": {"mouse": values.mouse},
        "tak": {
            **({"server": values.tak} if values.tak else {}),
            "origin": values.tak_origin,
            **{name: str(path) for name, path in tls.items() if path is not None},
        },
        "rules": {verb: {"rules": values.rules} for verb in ("list", "search")},
        "scenarios": {verb: {"world": values.world} for verb in ("list", "show", "check")},
    }
