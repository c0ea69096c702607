"""Terminal codes that call an operator's attention: notice, window title.

A terminal that does not know a code ignores it.
"""

from pa_console.schema.text import visible_line

TITLE = "PA Console"


def notice(text: str) -> str:
    """Return the codes of a desktop notice: OSC 9 for some terminals, OSC 777 for others."""
    plain = visible_line(text).replace(";", ",")
    return f"\x1b]9;{TITLE}: {plain}\x07\x1b]777;notify;{TITLE};{plain}\x07"


def window_title(text: str = "") -> str:
    """Return the code that names the window: what waits, or the console alone."""
    plain = visible_line(text)
    return f"\x1b]2;▲ {plain} - {TITLE}\x07" if plain else f"\x1b]2;{TITLE}\x07"


KEEP_TITLE = "\x1b[22;2t"
"""Has the terminal remember the title that its window has."""
RESTORE_TITLE = "\x1b[23;2t"
"""Has it take that title again."""
