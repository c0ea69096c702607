"""The after-action report as a table: what is told, and what is told of it.

The log has the report as lines of text; a row is made of each.
"""

import re

from pa_console.session.trace.parts import Column, Span, Table, table

_ACTION = re.compile(r"- (?P<what>\S+ [^:]+)(?:: (?P<told>.*))?")
_LABEL = re.compile(r"(?P<what>[^:]{1,120}?)(?:: |\. (?=Rationale))(?P<told>.+)")
_COLUMNS = (Column("what", 24, stress="bold"), Column("told"))


def report_table(text: str) -> Table:
    """Return the lines of a report as rows; a line without a label is a row of its own."""
    rows: list[list[str]] = []
    for line in filter(None, (line.strip() for line in text.splitlines())):
        action, labelled = _ACTION.fullmatch(line), _LABEL.fullmatch(line)
        if action is not None:
            rows.append([action["what"], action["told"] or "no telemetry was looked at"])
        elif labelled is not None:
            rows.append([labelled["what"], labelled["told"]])
        elif line.startswith("All gates covered"):
            rows.append(["Gates", "all covered"])
        else:
            rows.append(["", line])
    return table(_COLUMNS, ([Span(what, "", "bold"), Span(told)] for what, told in rows))
