"""`pa-console alert`: a test alert to all people who would be alerted."""

import typer

from pa_console.cli.options import AlertLaterOption, AlertOption, JsonOption
from pa_console.resources import naming_what_is_missing
from pa_console.station.alarms.alerts import Message
from pa_console.terminal.output import FAILED, out, print_json

TEST = Message(
    "PA Console: a test alert",
    "Alerts of the console arrive here. Nothing has happened, and nobody has to act.",
    None,
    later=True,
)


def alert(
    alert: AlertOption = None, alert_later: AlertLaterOption = None, json: JsonOption = False
) -> None:
    """Send a test alert to everybody who would be alerted; exit code 1 when one is not reached."""
    if not (alert or alert_later):
        raise ValueError("nobody is to be alerted: give --alert URL, or set PA_CONSOLE_ALERT")
    with naming_what_is_missing("alert", "alerts need"):
        from pa_console.observability.alert_delivery import receivers, try_all  # noqa: PLC0415 - only if used

    problems = try_all(receivers(alert or (), alert_later or ()), TEST)
    if json:
        print_json([{"receiver": name, "problem": why} for name, why in problems.items()])
    else:
        for name, why in problems.items():
            out.print_line(f"✘ {name}: {why}" if why else f"✔ {name}: delivered")
    raise typer.Exit(FAILED if any(problems.values()) else 0)
