"""The console's dark and light themes, and the contrast that makes every theme readable.

Textual's own themes can be chosen too.
"""

from collections.abc import Iterable, Mapping
from itertools import chain

from textual.color import Color
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
"""Colours for themes that do not define them, before `readable` adjusts their contrast."""

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


LEAST = 4.5
"""The minimum contrast ratio of text and background, from WCAG 2 AA."""

TEXTS = (
    "foreground", "text-primary", "text-success", "text-warning", "text-error", "text-accent",
    "quiet",
)  # fmt: skip
"""The names of the text colours."""

GROUNDS = ("background", "surface", "panel")
"""The names of the backgrounds of text."""

BADGES = {"primary": 0.22, "success": 0.22, "accent": 0.22, "error": 0.25}
"""The share of each colour in the fill behind a sign whose text has the colour of that name."""

FILLS = ("primary", "success", "warning", "error", "accent", "quiet")
"""The solid fills; a sign on one of them is black or white."""

_STEP = 0.04
_BLACK, _WHITE = Color.parse("#000000"), Color.parse("#ffffff")

_NO_BADGE = {f"badge-{name}": "ansi_default" for name in BADGES}
_ANSI = {
    True: {
        **_NO_BADGE,
        "text-primary": "ansi_bright_cyan", "text-success": "ansi_bright_green",
        "text-warning": "ansi_bright_yellow", "text-error": "ansi_bright_red",
        "text-accent": "ansi_bright_magenta", "quiet": "ansi_white",
        "on-primary": "ansi_bright_white", "on-success": "ansi_black", "on-warning": "ansi_black",
        "on-error": "ansi_bright_white", "on-accent": "ansi_black", "on-quiet": "ansi_black",
    },
    False: {
        **_NO_BADGE,
        "text-primary": "ansi_blue", "text-success": "ansi_default", "text-warning": "ansi_magenta",
        "text-error": "ansi_red", "text-accent": "ansi_magenta", "quiet": "ansi_default",
        "on-primary": "ansi_bright_white", "on-success": "ansi_black", "on-warning": "ansi_black",
        "on-error": "ansi_bright_white", "on-accent": "ansi_black", "on-quiet": "ansi_bright_white",
    },
}  # fmt: skip
"""Variables for themes that use the terminal's colours; the key is True for a dark theme."""


def luminance(colour: Color) -> float:
    """Return the relative luminance of a colour, from 0 to 1, as WCAG 2 defines it."""
    red, green, blue = (
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4
        for part in (colour.r / 255, colour.g / 255, colour.b / 255)
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(first: Color, second: Color) -> float:
    """Return the contrast ratio of two colours, from 1 to 21."""
    darker, lighter = sorted((luminance(first), luminance(second)))
    return (lighter + 0.05) / (darker + 0.05)


def readable(variables: Mapping[str, str], *, dark: bool, ansi: bool) -> dict[str, str]:
    """Return `variables` with text colours readable on all backgrounds, and fills for signs.

    A text colour keeps its hue and moves towards white or black only as far as necessary. The
    values of a terminal's sixteen colours are unknown, so themes that use them (`ansi`) get colour
    names that look different on usual palettes.
    """
    if ansi:
        return {**variables, **_ANSI[dark]}
    base, *_ = grounds = [Color.parse(variables[name]) for name in GROUNDS]
    colours = {
        f"badge-{name}": base.blend(Color.parse(variables[name]), share)
        for name, share in BADGES.items()
    }
    for name in TEXTS:
        badge = colours.get(f"badge-{name.removeprefix('text-')}")
        behind = [*grounds, badge] if badge is not None else grounds
        colours[name] = _readable(base.blend(*_opaque(variables[name])), behind, dark=dark)
    for name in FILLS:
        fill = colours["quiet"] if name == "quiet" else Color.parse(variables[name])
        colours[f"on-{name}"] = max((_BLACK, _WHITE), key=lambda ink: contrast(ink, fill))
    return {**variables, **{name: colour.hex for name, colour in colours.items()}}


def _opaque(name: str) -> tuple[Color, float]:
    colour = Color.parse(name)
    return colour.with_alpha(1.0), colour.a


def _readable(text: Color, grounds: Iterable[Color], *, dark: bool) -> Color:
    """Return `text`, moved towards white or black until its contrast with `grounds` is enough."""
    end, grounds = (_WHITE if dark else _BLACK), tuple(grounds)
    steps = (text.blend(end, share * _STEP) for share in range(round(1 / _STEP) + 1))
    candidates = chain(steps, (end,))
    return next(
        (
            candidate
            for candidate in candidates
            if min(contrast(candidate, ground) for ground in grounds) >= LEAST
        ),
        end,
    )
