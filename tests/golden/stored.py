"""Keeps what was recorded, and tells what differs first from it."""

import gzip
import hashlib
import json
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any, cast

import pytest

_Object = dict[str, Any]
HERE = Path(__file__).parent
SHOWN, BEFORE = 160, 40
"""Characters of a value that are shown, and how many of them before the first that differs."""
HOW = "If the change is meant, record it anew: python -m tests.golden.record {part}"


def sha256(text: str) -> str:
    """Return the SHA-256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def read(name: str) -> Any:
    """Return the stored document `name`, JSON or gzipped lines."""
    path = HERE / name
    if path.suffix == ".gz":
        return gzip.decompress(path.read_bytes()).decode().splitlines()
    return json.loads(path.read_text(encoding="utf-8"))


def write(name: str, document: Any) -> None:
    """Store a document as JSON, or lines as gzipped text; equal documents give equal files."""
    path = HERE / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gz":
        text = "".join(f"{line}\n" for line in document)
        path.write_bytes(gzip.compress(text.encode(), mtime=0))
    else:
        path.write_text(f"{json.dumps(document, indent=1, ensure_ascii=False)}\n", encoding="utf-8")


def write_text(name: str, text: str) -> None:
    """Store a readable text."""
    path = HERE / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def compare(part: str, stored: Any, now: Any, look: str = "") -> None:
    """Fail the test with the first differences between what is stored and what is so now.

    `look` says how more can be seen of them.
    """
    found = list(differences(stored, now))
    if found:
        first = "\n".join(f"  {line}" for line in found[:5])
        more = f"\n  and {len(found) - 5} more" if len(found) > 5 else ""
        text = f"{len(found)} differences from the golden data:\n{first}{more}"
        pytest.fail("\n".join(filter(None, [text, look, HOW.format(part=part)])), pytrace=False)


def differences(stored: Any, now: Any, where: str = "") -> Iterator[str]:
    """Yield where two JSON values differ, in order."""
    if isinstance(stored, dict) and isinstance(now, dict):
        yield from _of_mappings(cast(_Object, stored), cast(_Object, now), where)
    elif isinstance(stored, list) and isinstance(now, list):
        nothing = object()
        for number, (old, new) in enumerate(zip_longest(stored, now, fillvalue=nothing)):  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
            place = f"{where}[{number}]"
            if old is nothing:
                yield f"{place}: is new: {_short(new)}"
            elif new is nothing:
                yield f"{place}: is gone: {_short(old)}"
            else:
                yield from differences(old, new, place)
    elif isinstance(stored, str) and isinstance(now, str) and stored != now:
        pairs = enumerate(zip(stored, now, strict=False))
        same = next((n for n, (a, b) in pairs if a != b), min(len(stored), len(now)))
        begin = max(0, same - BEFORE) if max(len(stored), len(now)) > SHOWN else 0
        at = f" at character {same}" if begin else ""
        yield f"{where}{at}: was {_short(stored[begin:])}, is {_short(now[begin:])}"
    elif stored != now:
        yield f"{where}: was {_short(stored)}, is {_short(now)}"


def _of_mappings(stored: _Object, now: _Object, where: str) -> Iterator[str]:
    """Yield the differences of two objects; the order of their keys counts too."""
    for key in {**stored, **now}:
        place = f"{where}/{key}"
        if key not in stored:
            yield f"{place}: is new: {_short(now[key])}"
        elif key not in now:
            yield f"{place}: is gone: {_short(stored[key])}"
        else:
            yield from differences(stored[key], now[key], place)
    if stored.keys() == now.keys() and list(stored) != list(now):
        yield f"{where}: the order of {', '.join(stored)} has become {', '.join(now)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"
