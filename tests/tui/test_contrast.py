"""Every text of every theme has the contrast that WCAG AA asks for, wherever it stands."""

from pathlib import Path

import pytest
from textual.color import Color
from textual.theme import BUILTIN_THEMES

from pa_console.tui.theme import BADGES, FILLS, GROUNDS, LEAST, TEXTS, THEMES, contrast
from tests.tui.scripted import ScriptedStation, console

NAMES = [*(theme.name for theme in THEMES), *BUILTIN_THEMES]
PALETTES = {
    "xterm": {
        "black": "#000000", "red": "#cd0000", "green": "#00cd00", "yellow": "#cdcd00",
        "blue": "#0000ee", "magenta": "#cd00cd", "cyan": "#00cdcd", "white": "#e5e5e5",
        "bright_black": "#7f7f7f", "bright_red": "#ff0000", "bright_green": "#00ff00",
        "bright_yellow": "#ffff00", "bright_blue": "#5c5cff", "bright_magenta": "#ff00ff",
        "bright_cyan": "#00ffff", "bright_white": "#ffffff",
    },
    "vga": {
        "black": "#000000", "red": "#aa0000", "green": "#00aa00", "yellow": "#aa5500",
        "blue": "#0000aa", "magenta": "#aa00aa", "cyan": "#00aaaa", "white": "#aaaaaa",
        "bright_black": "#555555", "bright_red": "#ff5555", "bright_green": "#55ff55",
        "bright_yellow": "#ffff55", "bright_blue": "#5555ff", "bright_magenta": "#ff55ff",
        "bright_cyan": "#55ffff", "bright_white": "#ffffff",
    },
}  # fmt: skip
"""The sixteen colours of two kinds of terminals."""


def colours(tmp_path: Path, theme: str) -> dict[str, str]:
    app = console(ScriptedStation(), tmp_path)
    app.theme = theme
    return app.get_css_variables()


@pytest.mark.parametrize("theme", [name for name in NAMES if not name.startswith("ansi")])
def test_texts_signs_and_badges_can_be_read(tmp_path: Path, theme: str) -> None:
    known = {name: Color.parse(value) for name, value in colours(tmp_path, theme).items()
             if name in {*TEXTS, *GROUNDS, *FILLS, *(f"badge-{n}" for n in BADGES),
                         *(f"on-{n}" for n in FILLS)}}  # fmt: skip
    pairs = [
        *((text, ground) for text in TEXTS for ground in GROUNDS),
        *((f"text-{name}", f"badge-{name}") for name in BADGES),
        *((f"on-{name}", name) for name in FILLS),
    ]
    low = {pair: round(found, 2) for pair in pairs
           if (found := contrast(*(known[name] for name in pair))) < LEAST}  # fmt: skip
    assert not low


@pytest.mark.parametrize("palette", PALETTES)
@pytest.mark.parametrize(("theme", "ground"), [("ansi-dark", "black"), ("ansi-light", "white")])
def test_the_terminal_s_own_colours_are_chosen_so_that_they_differ(
    tmp_path: Path, theme: str, ground: str, palette: str
) -> None:
    known, table = colours(tmp_path, theme), PALETTES[palette]
    behind = Color.parse("#000000" if ground == "black" else "#ffffff")
    for name in TEXTS:
        ink = known[name].removeprefix("ansi_")
        if ink != "default":
            assert contrast(Color.parse(table[ink]), behind) >= LEAST, (name, ink)
    for name in BADGES:
        assert known[f"badge-{name}"] == "ansi_default"
    for name in FILLS:
        assert known[f"on-{name}"] != known[name]
