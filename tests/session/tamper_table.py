"""`python -m tests.session.tamper_table` shows what is found of all damage and of flipped bytes."""

import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pa_console.session.log.verification import verify
from tests.session.tamper import KNOWN, TAMPERS, damaged, write_signed


def flips(content: bytes, count: int, seed: int) -> Iterator[tuple[int, bytes]]:
    """Yield `count` times (line from 1, `content` with one byte changed on it)."""
    chosen = random.Random(seed)
    for _ in range(count):
        place, change = chosen.randrange(len(content)), chosen.randrange(1, 256)
        flipped = bytes([content[place] ^ change])
        line = content[:place].count(b"\n") + 1
        yield line, content[:place] + flipped + content[place + 1 :]


def main() -> None:
    """Print what is found of every damage."""
    with tempfile.TemporaryDirectory() as name:
        for number, tamper in enumerate(TAMPERS):
            folder = Path(name, str(number))
            folder.mkdir()
            found = damaged(tamper, folder)
            place = f"line {found.first_bad_line}" if found.first_bad_line else "head"
            right = (found.damage, found.first_bad_line) == (tamper.kind, tamper.line)
            print(f"{'ok ' if right else 'BAD'} {tamper.name:40} {place:8} {found.damage}")
        log = write_signed(Path(name, "flipped.jsonl"))
        content, detected, named = log.read_bytes(), 0, 0
        for line, changed in flips(content, 1000, seed=1):
            log.write_bytes(changed)
            found = verify(log, KNOWN)
            detected += not found.ok
            named += found.first_bad_line == line
        print(f"1000 random single-byte flips: {detected} detected, {named} on their line")


if __name__ == "__main__":
    main()
