"""Writes copied text to a file as well, for terminals that do not take the clipboard code."""

from pathlib import Path

from platformdirs import user_state_path

from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.rows import plain
from pa_console.tui.screens.plan_editor import plan_json
from pa_console.tui.widgets.trace_pane import sections
from pa_console.views.trace_planning import Rules


def trace_text(trace: MissionTrace, rules: Rules) -> str:
    """Return the whole trace as text, folded sections included."""
    mission = trace.mission
    head = f"{mission.id}  {mission.created:%Y-%m-%d %H:%M:%S} UTC\n{mission.said}\n"
    head += f"read as: {mission.text}\n" if mission.typed else ""
    return head + plain(sections(trace, rules))


def plan_text(trace: MissionTrace) -> str:
    """Return the JSON of the latest plan that could be read, else the model's last answer."""
    for attempt in reversed(trace.attempts):
        if attempt.plan is not None:
            return plan_json(attempt.plan)
    return trace.attempts[-1].text if trace.attempts else ""


def export_folder() -> Path:
    """Return where copies are written for this user."""
    return user_state_path("pa-console") / "copies"


def write_copy(folder: Path, name: str, text: str) -> str:
    """Write `text` to `folder`; return where, or why that was not possible."""
    path = folder / name
    try:
        make_private_folder(folder)
        replace_private(path, visible(text).encode())
    except OSError as error:
        return f"not written to a file: {error.strerror or error}"
    return f"written to {path}"
