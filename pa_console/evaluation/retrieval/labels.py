"""Loads labelled queries for a rule file."""

from collections.abc import Iterable
from pathlib import Path

from pa_console.schema.document import Document
from pa_console.schema.retrieval import QuerySet
from pa_console.schema.rule import Rule

MOST_NAMED = 40


def load_queries(path: Path, rules: Iterable[Rule]) -> QuerySet:
    """Read the queries at `path` for `rules`; raises DocumentError with file, line and field.

    Ids must be unique, texts too, and every rule named must be one of `rules`.
    """
    document = Document.read(path)
    found = document.parse(QuerySet)
    known = {rule.id for rule in rules}
    some = ", ".join(sorted(known)[:MOST_NAMED])
    ids: set[str] = set()
    texts: set[str] = set()
    for index, query in enumerate(found.queries):
        place = ("queries", index)
        if query.id in ids:
            raise document.error((*place, "id"), f"{query.id!r} appears twice")
        if query.text in texts:
            raise document.error((*place, "text"), f"{query.text!r} appears twice")
        ids.add(query.id)
        texts.add(query.text)
        for rule in query.relevant:
            if rule not in known:
                problem = f"there is no rule {rule!r} in the rule file; known: {some}"
                raise document.error((*place, "relevant", rule), problem)
    return found
