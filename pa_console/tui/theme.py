"""The console's own dark and light colours; all of Textual's themes can be chosen beside them."""

from textual.theme import Theme

DEFAULT_THEME = "pa-console"

VARIABLES = {
    "quiet": "#87919b",
    "faint": "#6a747e",
    **dict.fromkeys(("badge-primary", "badge-success", "badge-accent", "badge-error"), "#6a747e"),
    **dict.fromkeys(
        ("on-primary", "on-success", "on-warning", "on-error", "on-accent", "on-quiet"), "#000000"
    ),
}
"""Colours for the themes that do not bring their own, before `contrast` makes them readable."""

THEMES = (
    Theme(
        name=DEFAULT_THEME,
        primary="#6fb3d2",
        secondary="#8aa0b5",
        accent="#e6b450",
        warning="#e6b450",
        error="#f0716d",
        success="#7fc98b",
        foreground="#d5dde5",
        background="#0f1419",
        surface="#151c23",
        panel="#1e2832",
        dark=True,
        variables={
            "border": "#3a4a59",
            "border-blurred": "#2a3743",
            "quiet": "#8593a1",
            "scrollbar": "#2f3d4a",
            "scrollbar-background": "#131a21",
            "scrollbar-corner-color": "#131a21",
            "faint": "#3d4b58",
        },
    ),
    Theme(
        name="pa-console-light",
        primary="#1f6f9a",
        secondary="#56697a",
        accent="#96650a",
        warning="#96650a",
        error="#b3261e",
        success="#24743a",
        foreground="#1c2733",
        background="#f6f7f8",
        surface="#eceff1",
        panel="#dfe4e8",
        dark=False,
        variables={
            "border": "#9fb0bd",
            "border-blurred": "#c5d0d8",
            "quiet": "#5d6b78",
            "scrollbar": "#b4c0c9",
            "scrollbar-background": "#eceff1",
            "scrollbar-corner-color": "#eceff1",
            "faint": "#b4c0c9",
        },
    ),
)
