"""The start of child processes that run this Python, without code from the working folder.

Python imports from the folder in which it was started before all others. An empty part of a path,
as in `LD_LIBRARY_PATH=:/opt/lib`, means that folder too. It may hold files of other people: a
download, a clone, a shared disk.
"""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager

OWN_FOLDER = os.sep
"""The folder in which children start; only the administrator of the machine can put files there."""

SAFE_PATH, SEARCH_PATH = "PYTHONSAFEPATH", "PYTHONPATH"


def python_command(*arguments: str) -> tuple[str, ...]:
    """Return the command that runs this Python without imports from the working folder.

    Start the child in OWN_FOLDER; paths in `arguments` must be absolute.
    """
    return sys.executable, "-P", *arguments


def keep_search_path() -> None:
    """Make the user's PYTHONPATH absolute, so that it names the same folders for children.

    An empty part is left out, because for Python it means the folder in which it was started.
    """
    if given := os.environ.get(SEARCH_PATH):
        parts = (os.path.abspath(part) for part in given.split(os.pathsep) if part)
        os.environ[SEARCH_PATH] = os.pathsep.join(parts)


@contextmanager
def isolated_workers() -> Generator[None]:
    """Make a library start its processes without imports from the working folder.

    `multiprocessing` (and Dask with it) passes on the environment, but no option like `-P`.
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
