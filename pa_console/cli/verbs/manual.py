"""`pa-console manual`: the pages of the manual in the terminal."""

import os
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli import completion
from pa_console.cli.options import JsonOption
from pa_console.manual_pages import Page, load_manual
from pa_console.terminal.output import out, print_document, print_json

COLOURED = "-FRX"
"""The options with which `less` shows colours, and exits at once if a page fits the screen."""


def manual(
    topic: Annotated[
        str | None,
        typer.Argument(
            help="Page to show. Default: list all pages.",
            autocompletion=completion.manual_pages,
        ),
    ] = None,
    plain: Annotated[
        bool, typer.Option("--plain", help="Print the page as Markdown source, without a pager.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """List the pages of the manual, or show one."""
    if topic is None:
        _list(load_manual().pages, json)
    else:
        _show(load_manual().find(topic), plain, json)


def _list(pages: tuple[Page, ...], json: bool) -> None:
    if json:
        print_json([_about(page) for page in pages])
        return
    table = Table("page", "contents", box=None, pad_edge=False)
    for page in pages:
        table.add_row(page.name, page.summary)
    out.print(table)


def _show(page: Page, plain: bool, json: bool) -> None:
    """Print the page, formatted on a terminal and as Markdown text elsewhere."""
    if json:
        headings = [section.heading for section in page.sections]
        print_json(_about(page) | {"sections": headings, "text": page.text})
    elif plain or not out.is_terminal:
        print_document(page.text)
    else:
        from rich.markdown import Markdown  # noqa: PLC0415 - only on a terminal

        os.environ.setdefault("LESS", COLOURED)
        with out.pager(styles=True):
            out.print(Markdown(page.text, hyperlinks=False))


def _about(page: Page) -> dict[str, object]:
    return {"name": page.name, "title": page.title, "summary": page.summary}
