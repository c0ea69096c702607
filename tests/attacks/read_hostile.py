"""Reads the hostile files of a kind, each in a process of its own, and tells what each one cost."""

import json
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from pa_console.cli.sessions.mission import read_event
from pa_console.evaluation.jobs import load_with_worlds
from pa_console.policy.rule_seal import seal_of
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from pa_console.schema.rule import RuleSet
from pa_console.settings.sources import load_settings
from pa_console.sim.worlds.scenario_file import load_scenario
from pa_console.sim.worlds.world_file import load_world
from tests.attacks.hostile_files import KINDS, hostile_files

LONGEST_S = 60
MOST_BYTES = 4 << 30


class Cost(NamedTuple):
    """What reading one file came to: read, refused (with the error), or what it did instead."""

    kind: str
    trick: str
    outcome: str
    error: str
    seconds: float
    grown_mb: float
    whole_mb: float

    @property
    def amiss(self) -> bool:
        """True unless it was read or refused within 100 MB, and in words that a terminal shows."""
        return (
            self.outcome not in ("read", "refused") or self.grown_mb > 100 or "\x1b" in self.error
        )


def costs(kind: str, every: int = 1) -> Iterator[Cost]:
    """Read each hostile file of `kind`, or one in `every`, and yield what it cost."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        read = _reader(kind, folder)
        for trick, text in [*hostile_files(kind).items()][::every]:
            path = folder / f"{kind}.yaml"
            path.write_text(text, encoding="utf-8")
            yield _alone(kind, trick, lambda path=path: read(path))


def _reader(kind: str, folder: Path) -> Callable[[Path], object]:
    """Return what reads a file of `kind` in the console."""
    world = load_world(find_data("worlds", "checkpoint", "world.yaml"))
    rules = folder / "signed.yaml"
    rule_set = RuleSet.model_validate_json(
        '{"name": "own", "rules": [{"id": "ROE-01", "domain": "ROE", "priority": "high", '
        '"text": "x"}]}'
    )

    def signature(path: Path) -> None:
        path.rename(rules.with_name(rules.name + ".sig"))
        seal = seal_of(rules, rule_set)
        if seal.altered:
            raise DocumentError(str(rules), 0, "", seal.problem)

    def settings(path: Path) -> None:
        os.environ["PA_CONSOLE_SETTINGS"] = str(path)
        load_settings()

    readers: dict[str, Callable[[Path], object]] = {
        "rules": load_rules,
        "signature": signature,
        "world": load_world,
        "scenario": lambda path: load_scenario(path, world),
        "missions": lambda path: load_with_worlds(path, world),
        "settings": settings,
        "event": lambda path: read_event(1, path.read_text(encoding="utf-8")),
    }
    return readers[kind]


def _alone(kind: str, trick: str, read: Callable[[], object]) -> Cost:
    """Call `read` in a child, which is ended when it takes more than a minute or 4 GB."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    out, into = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(out)
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S + 1))
        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
        _tell(into, read)
    os.close(into)
    with open(out, "rb") as pipe:
        told = pipe.read()
    status = os.waitpid(child, 0)[1]
    if not told:
        return Cost(kind, trick, f"ended by signal {os.WTERMSIG(status)}", "", LONGEST_S, 0.0, 0.0)
    outcome, error, seconds, whole = json.loads(told)
    return Cost(kind, trick, outcome, error, seconds, (whole - before) / 1024, whole / 1024)


def _tell(into: int, read: Callable[[], object]) -> None:
    """Read, write what came of it into the pipe, and end the process."""
    begun = time.process_time()
    outcome, error = "read", ""
    try:
        read()
    except DocumentError as refused:
        outcome, error = "refused", str(refused)
    except BaseException as other:
        outcome, error = type(other).__name__, str(other)[:200]
    seconds = time.process_time() - begun
    whole = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    os.write(into, json.dumps((outcome, error[:3000], seconds, whole)).encode())
    os._exit(0)


def campaign(_count: int, _seed: int) -> tuple[list[str], list[str]]:
    """Read every hostile file of every kind; return what each cost, and what was amiss."""
    found = [cost for kind in KINDS for cost in costs(kind)]
    amiss = [f"{one.kind}: {one.trick}: {one.outcome}" for one in found if one.amiss]
    return [json.dumps(one._asdict()) for one in found], amiss
