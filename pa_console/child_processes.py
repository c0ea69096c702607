"""How child processes start that run this Python, so that no code of the working folder runs.

Python looks for modules in the folder it was started in first, and so does what reads a path with
an empty part, such as `LD_LIBRARY_PATH=:/opt/lib`. Anybody may have put files there: a download, a
clone, a shared disk.
"""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager

OWN_FOLDER = os.sep
"""Where children are started: only the administrator of the machine puts files there."""

SAFE_PATH, SEARCH_PATH = "PYTHONSAFEPATH", "PYTHONPATH"


def python_command(*arguments: str) -> tuple[str, ...]:
    """Return the command that runs this Python, which imports nothing of the working folder.

    The child is to be started in OWN_FOLDER, so paths in `arguments` have to be whole.
    """
    return sys.executable, "-P", *arguments


def keep_search_path() -> None:
    """Have PYTHONPATH, which is the user's own, mean the same folders to children.

    An empty part of it is left out: to Python it is the folder it was started in.
    """
    if given := os.environ.get(SEARCH_PATH):
        parts = (os.path.abspath(part) for part in given.split(os.pathsep) if part)
        os.environ[SEARCH_PATH] = os.pathsep.join(parts)


@contextmanager
def isolated_workers() -> Generator[None]:
    """Have processes that a library starts in the context import nothing of the working folder.

    `multiprocessing`, and so Dask, pass an environment on and no options of this Python.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before
