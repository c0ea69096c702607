"""What the default model answers and what comes of it, token for token; minutes, so on demand.

The missions of the paper and every third of the field set go through the command line. Everything
is read from what it writes, so nothing of the package is imported.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.golden.stored import compare, read, write

ON = "PA_GOLDEN_OUTCOMES"
FILE = "outcomes.json"
CLI = [sys.executable, "-m", "pa_console"]
SETS = {"paper": [], "field": ["--every", "3"]}
"""The mission sets with the words that choose their missions."""
KEPT = (
    "status", "reason", "refused", "strict", "obeyed", "hybrid", "failed", "broken", "judge_plan",
    "judge_outcome", "verification", "confidence", "offered", "valid_json", "first_sound",
    "attempts", "plan",
)  # fmt: skip
"""What is compared of the record of a run."""
MISSION = re.compile(r"M\d{3}-[0-9a-f]{4}")


def record() -> None:
    """Write what is so now."""
    with tempfile.TemporaryDirectory() as folder:
        write(FILE, outcomes(Path(folder)))


@pytest.mark.skipif(ON not in os.environ, reason=f"takes minutes; {ON}=1 turns it on")
@pytest.mark.timeout(3600)
def test_the_default_model_answers_the_same_and_it_comes_to_the_same(tmp_path: Path) -> None:
    if not fetched():
        pytest.skip("the default model is not on this machine; see 'pa-console models pull'")
    look = f"The stored ones are in tests/golden/{FILE}, the logs of this run in {tmp_path}."
    compare("outcomes", read(FILE), outcomes(tmp_path), look)


def fetched() -> bool:
    """Whether the default model is on this machine."""
    done = subprocess.run([*CLI, "models", "list", "--json"], capture_output=True, check=True)
    return any(model["default"] and model["path"] for model in json.loads(done.stdout))


def outcomes(folder: Path) -> dict[str, Any]:
    """Run the missions and return what came of each, by set and mission."""
    found: dict[str, Any] = {}
    for name, words in SETS.items():
        out = folder / name
        call = [*CLI, "eval", "--missions", name, *words, "--out", str(out)]
        with one_core():
            subprocess.run(call, check=True, stdout=subprocess.DEVNULL)
        found |= read_runs(name, out)
    return found


@contextmanager
def one_core() -> Generator[None]:
    """Let processes that are started meanwhile compute on one core, as when it was recorded.

    Threads that share a sum add it up in another order, and so the last digits differ.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def read_runs(name: str, out: Path) -> dict[str, Any]:
    """Return what came of each mission of an evaluation, by set and mission."""
    found: dict[str, Any] = {}
    for line in (out / "runs.jsonl").read_text(encoding="utf-8").splitlines():
        run = json.loads(line)
        told = {key: run[key] for key in KEPT} | told_of(out / run["log"])
        text = MISSION.sub("MISSION", json.dumps(told, ensure_ascii=False))
        found[f"{name} {run['mission']}"] = json.loads(text)
    return found


def told_of(log: Path) -> dict[str, list[str]]:
    """Return what a log tells of answers, verdicts, commands and the end, in order.

    A verdict on an outcome stands where telemetry told of that outcome, whenever it came.
    """
    told: dict[str, list[str]] = {"planner": [], "judge": [], "commands": [], "outcome": []}
    to_come: list[int] = []
    for line in log.read_text(encoding="utf-8").splitlines():
        record = json.loads(line)
        data = record["data"]
        match record["kind"]:
            case "plan_proposed":
                told["planner"].append(data["text"])
            case "plan_judged":
                told["judge"].append(json.dumps(data["verdict"], ensure_ascii=False))
            case "outcome_judged":
                told["judge"][to_come.pop(0)] = json.dumps(data["verdict"], ensure_ascii=False)
            case "command_sent":
                command = data["command"]
                words = (command["agent"], command["verb"], command["target"])
                told["commands"].append(" ".join(filter(None, words)))
            case "mission_verified":
                told["outcome"].append(json.dumps(data["verification"], ensure_ascii=False))
                to_come.append(len(told["judge"]))
                told["judge"].append("")
            case _:
                pass
    return told
