"""The colours of the status words on the screen: a theme's colour for every tone."""

from typing import NamedTuple

from textual.content import Content

from pa_console.views.status_words import STATUSES, Tone, status_of

GOOD, BAD, WARN = "$text-success", "$text-error", "$text-warning"
CALM, QUIET, NOTE = "$text-primary", "$quiet", "$text-accent"
STYLES: dict[Tone, str] = {
    "": "",
    "good": GOOD,
    "bad": BAD,
    "warn": WARN,
    "calm": CALM,
    "quiet": QUIET,
    "note": NOTE,
}


class Term(NamedTuple):
    """The presentation of one status everywhere."""

    glyph: str
    word: str
    style: str

    @property
    def content(self) -> Content:
        """The glyph and the word, coloured."""
        return Content.styled(f"{self.glyph} {self.word}", self.style)


def term(family: str, value: str) -> Term:
    """Return how `value` of `family` is shown; a value not in the table is shown as unknown."""
    glyph, word, tone = status_of(family, value)
    return Term(glyph, word, STYLES[tone])


TERMS = {name: term(*name.split(".", 1)) for name in STATUSES}
"""Every status word, for a page that explains them."""
