"""The console's process never loads the language model libraries."""

import subprocess
import sys

SCRIPT = """\
import sys
import pa_console.llm.roles.planner, pa_console.llm.roles.judge, pa_console.llm.models.fetching
print([name for name in ("llama_cpp", "llguidance", "huggingface_hub") if name in sys.modules])
"""


def test_only_the_worker_loads_the_model_libraries():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
