"""What the default model's plans come to, judged by the strict scorer; minutes, so on demand.

The missions of the paper and every third of the field set go through the command line. Processors
add in another order and with other weights (bf16 or f16), so the model's words and probabilities
differ in their last digits, and a doubtful order may be read otherwise. What is sure is the same on
every processor: the end, the success and the last plan of an order of which the model is sure. Of
the others, the share of strict successes lies in the 95 % interval of the recorded one.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pa_console.evaluation.reporting.statistics import SuccessRate
from pa_console.session.confidence import UNSURE
from tests.golden.stored import HERE, compare, write_text

ON = "PA_GOLDEN_OUTCOMES"
FILE = "outcomes.txt"
CLI = [sys.executable, "-m", "pa_console"]
SETS = {"paper": [], "field": ["--every", "3"]}
"""The mission sets with the words that choose their missions."""
CARRIED_OUT = ("verified", "unverified")
SURE, SUCCESS = " sure;", "; strict success"


def record() -> None:
    """Write the outcomes as they are now."""
    with tempfile.TemporaryDirectory() as folder:
        lines = [f"{name}: {line(run)}\n" for name, run in runs(Path(folder)).items()]
    write_text(FILE, "".join(lines))


@pytest.mark.skipif(ON not in os.environ, reason=f"takes minutes; {ON}=1 turns it on")
@pytest.mark.timeout(3600)
def test_the_default_model_s_plans_come_to_the_same_on_every_processor(tmp_path: Path) -> None:
    if not fetched():
        pytest.skip("the default model is not on this machine; see 'pa-console models pull'")
    made = runs(tmp_path)
    stored = dict(
        text.split(": ", 1) for text in (HERE / FILE).read_text(encoding="utf-8").splitlines()
    )
    assert list(stored) == list(made)
    for name, run in made.items():
        assert not run["broken"], f"{name} broke an enforced rule"
        assert run["valid_json"] or run["status"] not in CARRIED_OUT, f"{name} was not planned"
    look = f"The stored ones are in tests/golden/{FILE}, the logs of this run in {tmp_path}."
    # A model that is less sure on this processor is counted with the doubtful ones.
    sure = [name for name in stored if SURE in stored[name] and SURE in line(made[name])]
    now = {name: line(made[name]) for name in sure}
    compare("outcomes", {name: stored[name] for name in sure}, now, look)
    doubtful = [name for name in stored if name not in sure]
    recorded = SuccessRate.of(SUCCESS in stored[name] for name in doubtful)
    successes = sum(made[name]["strict"] for name in doubtful)
    assert successes >= recorded.low * len(doubtful), f"{successes} of {len(doubtful)}; {look}"


def line(run: dict[str, Any]) -> str:
    """Return a run on a line: its end, success, the model's doubt, the verdicts, the last plan."""
    confidence = run["confidence"]
    parts = (
        f"{run['status']}{', refused' if run['refused'] else ''}",
        "strict success" if run["strict"] else "no strict success",
        "sure" if confidence is None or confidence >= UNSURE else "unsure",
        f"judge {run['judge_plan']}, {run['judge_outcome']}",
        f"telemetry {run['verification']}",
        ", ".join(run["plan"]) or "no plan",
    )
    return "; ".join(parts)


def fetched() -> bool:
    """Return whether the default model is on this machine."""
    done = subprocess.run([*CLI, "models", "list", "--json"], capture_output=True, check=True)
    return any(model["default"] and model["path"] for model in json.loads(done.stdout))


def runs(folder: Path) -> dict[str, dict[str, Any]]:
    """Run the missions and return the record of each run by set and mission."""
    for name, words in SETS.items():
        call = [*CLI, "eval", "--missions", name, *words, "--out", str(folder / name)]
        subprocess.run(call, check=True, stdout=subprocess.DEVNULL)
    return dict(read_runs(folder))


def read_runs(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the runs of each set below `folder`."""
    for name in SETS:
        for text in (folder / name / "runs.jsonl").read_text(encoding="utf-8").splitlines():
            run = json.loads(text)
            yield f"{name} {run['mission']}", run
