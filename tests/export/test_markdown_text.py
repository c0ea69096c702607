"""Any text shows as it is in Markdown, read by another library's GitHub flavour."""

import re

from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from markdown_it.token import Token

from pa_console.export.markdown import fenced, folded, inline, table

READER = MarkdownIt("gfm-like")
NASTY = st.text(alphabet=st.sampled_from("a1 |\\`*_[]()<>#~&;$@!-+=:.\n\r\thw/p\x00\x85é"))


def shown(token: Token) -> str:
    """The text of an inline token, which must hold nothing but text and line breaks."""
    texts: list[str] = []
    for child in token.children or []:
        assert child.type in ("text", "text_special", "html_inline"), child.type
        if child.type == "html_inline":
            assert child.content == "<br>"
        texts.append("\n" if child.type == "html_inline" else child.content)
    return "".join(texts)


def as_lines(text: str) -> str:
    """What a reader should see of `text`: its lines, stripped, control characters escaped."""
    lines = re.split(r"\r\n|[\r\n\x85]", text.strip())
    return "\n".join(line.strip().replace("\x00", r"\x00") for line in lines)


@given(NASTY)
def test_a_cell_holds_its_text_and_nothing_else(text: str) -> None:
    tokens = READER.parse(table(("head", "next"), [(text, "end")]))
    cells = [tokens[n + 1] for n, token in enumerate(tokens) if token.type == "td_open"]
    assert len(cells) == 2
    assert shown(cells[0]) == (as_lines(text) if text else "–")
    assert shown(cells[1]) == "end"


@given(NASTY)
def test_a_paragraph_stays_one(text: str) -> None:
    tokens = READER.parse(inline(text))
    assert [token.type for token in tokens] in (
        [],
        ["paragraph_open", "inline", "paragraph_close"],
    )
    assert (shown(tokens[1]) if tokens else "") == as_lines(text)


@given(NASTY)
def test_a_code_block_ends_where_its_text_ends(text: str) -> None:
    tokens = READER.parse(f"{fenced(text)}\n\nafter")
    assert [token.type for token in tokens][:2] == ["fence", "paragraph_open"]
    lines = re.split(r"\r\n|[\r\n\x85]", text)
    assert tokens[0].content == "\n".join(lines).replace("\x00", r"\x00") + "\n"


def test_what_is_folded_keeps_its_code_block() -> None:
    tokens = READER.parse(folded("a <b> & c", fenced("```\n</details>")))
    assert [token.type for token in tokens] == ["html_block", "fence", "html_block"]
    assert "a &lt;b&gt; &amp; c" in tokens[0].content
