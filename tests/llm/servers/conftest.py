"""A running server of llama-cpp-python, shared by all tests."""

import subprocess
import sys
from collections.abc import Iterator
from threading import Thread

import pytest

from pa_console.llm.models.catalogue import LocalModel

LISTENS = "Uvicorn running on http://127.0.0.1:"


@pytest.fixture(scope="session")
def llama_server(shallow_model: LocalModel) -> Iterator[int]:
    """The port of a server that has two layers of the smallest model."""
    options = ["--host", "127.0.0.1", "--port", "0", "--n_ctx", "1024", "--n_threads", "1"]
    command = [sys.executable, "-m", "llama_cpp.server", "--model", str(shallow_model.path)]
    server = subprocess.Popen(
        [*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        assert server.stderr is not None
        line = next((line for line in server.stderr if LISTENS in line), "")
        Thread(target=server.stderr.read, daemon=True).start()
        yield int(line.partition(LISTENS)[2].split()[0])
    finally:
        server.kill()
        server.communicate()
