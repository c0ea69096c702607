"""The pages of the manual, which are Markdown files in the package, and a search in them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import pairwise
from re import search, sub

from markdown_it import MarkdownIt
from markdown_it.token import Token
from rapidfuzz import process

FIRST = "index"
"""The first page of the manual; its links give the order of the others."""
AROUND = 70
"""The number of characters of a section that are shown with a search hit."""
ALIKE = 60
"""The least similarity, out of 100, at which a name is suggested in place of an unknown name."""


@dataclass(frozen=True)
class ManualSection:
    """A part of a page: its heading, and its text without markup."""

    heading: str
    text: str


@dataclass(frozen=True)
class Page:
    """A page: the name of its file, and a section for each heading, with the title first."""

    name: str
    summary: str
    text: str
    sections: tuple[ManualSection, ...]

    @property
    def title(self) -> str:
        """The first heading."""
        return self.sections[0].heading

    def heading_of(self, anchor: str) -> int:
        """Return the index of the heading that a link's `anchor` names; 0 if there is none."""
        anchors = [_anchor(section.heading) for section in self.sections]
        return anchors.index(anchor) if anchor in anchors else 0


@dataclass(frozen=True)
class SearchHit:
    """A section with all words of a search; `excerpt` is the text around the first such word."""

    page: Page
    number: int
    excerpt: str

    @property
    def heading(self) -> str:
        """The section's heading."""
        return self.page.sections[self.number].heading


class Manual:
    """All pages, in reading order."""

    def __init__(self, pages: Iterable[Page]) -> None:
        self.pages = tuple(pages)

    def find(self, topic: str) -> Page:
        """Return the page named `topic`, or the first page with a section of that name.

        Raises ValueError if there is none; the message names similar pages.
        """
        pages = {page.name: page for page in self.pages}
        name = topic.lower().removesuffix(".md")
        if name in pages:
            return pages[name]
        for page in self.pages:
            if page.heading_of(_anchor(name)):
                return page
        near = process.extract(name, list(pages), limit=3, score_cutoff=ALIKE)
        hint = f" Did you mean {' or '.join(match[0] for match in near)}?" if near else ""
        raise ValueError(f"the manual has no page {topic!r}.{hint} Pages: {', '.join(pages)}")

    def search(self, words: str) -> list[SearchHit]:
        """Return the sections that contain every word, in upper or lower case; none without words.

        Sections with one of the words in their heading come first.
        """
        wanted = words.lower().split()
        hits = [
            SearchHit(page, number, _excerpt(section.text, wanted))
            for page in self.pages
            for number, section in enumerate(page.sections)
            if wanted
            and all(word in f"{section.heading} {section.text}".lower() for word in wanted)
        ]
        hits.sort(key=lambda hit: not any(word in hit.heading.lower() for word in wanted))
        return hits


@cache
def load_manual() -> Manual:
    """Return the manual: the first page, the pages that it links to in order, then the others."""
    folder = files("pa_console") / "manual"
    texts = {
        part.name.removesuffix(".md"): part.read_text(encoding="utf-8")
        for part in sorted(folder.iterdir(), key=lambda part: part.name)
        if part.name.endswith(".md")
    }
    order = dict.fromkeys((FIRST, *linked_pages(texts.get(FIRST, "")), *texts))
    return Manual(read_page(name, texts[name]) for name in order if name in texts)


def read_page(name: str, text: str) -> Page:
    """Return the page of the Markdown `text`; without a heading, its name is its title."""
    tokens = _parsed(text)
    starts = [
        number
        for number, token in enumerate(tokens)
        if token.type == "heading_open" and token.level == 0
    ]
    sections = tuple(
        ManualSection(_plain(tokens[start + 1]), " ".join(_texts(tokens[start + 3 : end])))
        for start, end in pairwise((*starts, len(tokens)))
    )
    return Page(name, _summary(tokens), text, sections or (ManualSection(name, text),))


def _parsed(text: str) -> list[Token]:
    return MarkdownIt("gfm-like").parse(text)


def _anchor(heading: str) -> str:
    """Return a heading as a link anchor: lower-case letters, digits, and dashes for spaces."""
    return sub(r"\s+", "-", sub(r"[^\w\s-]", "", heading.lower()).strip())


def linked_pages(text: str) -> Iterator[str]:
    """Yield the names of the pages that the Markdown `text` links to, in order."""
    for token in _parsed(text):
        for part in token.children or ():
            file, _, _ = str(part.attrGet("href") or "").partition("#")
            if file.endswith(".md"):
                yield file.removesuffix(".md")


def _summary(tokens: list[Token]) -> str:
    """Return the first sentence of the first paragraph that has words."""
    for before, token in pairwise(tokens):
        if before.type == "paragraph_open" and before.level == 0 and (text := _plain(token)):
            sentence = search(r"^.*?[.!?](?=\s+[^a-z\s]|$)", text)
            return sentence[0] if sentence else text
    return ""


def _texts(tokens: list[Token]) -> Iterator[str]:
    for token in tokens:
        if token.type == "inline":
            yield _plain(token)
        elif token.type in {"fence", "code_block"}:
            yield " ".join(token.content.split())


def _plain(inline: Token) -> str:
    """Return the words of a text, without markup, link addresses or images."""
    words = (
        part.content if part.type in {"text", "code_inline"} else " "
        for part in inline.children or ()
        if part.type in {"text", "code_inline", "softbreak", "hardbreak"}
    )
    return " ".join("".join(words).split())


def _excerpt(text: str, words: list[str]) -> str:
    """Return the characters around the first of `words` that occurs in `text`."""
    lowered = text.lower()
    at = next((lowered.find(word) for word in words if word in lowered), 0)
    first = max(at - AROUND // 3, 0)
    end = first + AROUND
    return f"{'…' if first else ''}{text[first:end]}{'…' if end < len(text) else ''}"
