"""`pa-console alert`: a test alert to all people who would receive alerts."""

import typer

from pa_console.cli.options import AlertLaterOption, AlertOption, JsonOption
from pa_console.resources import naming_what_is_missing
from pa_console.station.alarms.alerts import Message
from pa_console.terminal.output import FAILED, out, print_json

TEST = Message(
    "PA Console: test alert",
    "PA Console can send alerts here. Nothing has happened; no action is needed.",
    None,
    later=True,
)


def alert(
    alert: AlertOption = None, alert_later: AlertLaterOption = None, json: JsonOption = False
) -> None:
    """Send a test alert to every receiver of alerts.

    Exits with 1 if a receiver could not be reached.
    """
    if not (alert or alert_later):
        raise ValueError("no receiver of alerts: give --alert URL, or set PA_CONSOLE_ALERT")
    with naming_what_is_missing("alert", "alerts need"):
        from pa_console.observability.alert_delivery import receivers, try_all  # noqa: PLC0415 - only if used

    problems = try_all(receivers(alert or (), alert_later or ()), TEST)
    if json:
        print_json([{"receiver": name, "problem": why} for name, why in problems.items()])
    else:
        for name, why in problems.items():
            out.print_line(f"✘ {name}: {why}" if why else f"✔ {name}: delivered")
    raise typer.Exit(FAILED if any(problems.values()) else 0)
