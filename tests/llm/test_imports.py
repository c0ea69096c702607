"""The console never loads the model's libraries, and the model's process little of the console."""

import subprocess
import sys

SCRIPT = """\
import sys
import pa_console.llm.roles.planner, pa_console.llm.roles.judge, pa_console.llm.models.fetching
print([name for name in ("llama_cpp", "llguidance", "huggingface_hub") if name in sys.modules])
"""


WORKER = """\
import sys
import pa_console.llm.local.worker
print([name for name in ("pa_console.language", "pa_console.llm.roles", "pa_console.signing",
    "pa_console.llm.models.catalogue", "pa_console.schema.events", "cryptography", "rapidfuzz")
    if name in sys.modules])
"""


def imported(script: str) -> str:
    """Return what a new Python prints that runs `script`."""
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_only_the_worker_loads_the_model_libraries():
    assert imported(SCRIPT) == "[]"


def test_the_worker_loads_nothing_of_the_console_that_it_does_not_need():
    assert imported(WORKER) == "[]"
