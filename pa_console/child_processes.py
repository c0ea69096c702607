"""Start of child processes that run this Python, without any code of the working folder.

Python imports from the folder it was started in before all others, and an empty part of a path,
such as in `LD_LIBRARY_PATH=:/opt/lib`, means that folder too. It may hold files of other people: a
download, a clone, a shared disk.
"""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager

OWN_FOLDER = os.sep
"""The folder in which children start: only the administrator of the machine puts files there."""

SAFE_PATH, SEARCH_PATH = "PYTHONSAFEPATH", "PYTHONPATH"


def python_command(*arguments: str) -> tuple[str, ...]:
    """Return the command that runs this Python without imports from the working folder.

    Start the child in OWN_FOLDER; paths in `arguments` must be absolute.
    """
    return sys.executable, "-P", *arguments


def keep_search_path() -> None:
    """Make the user's PYTHONPATH absolute, so that it names the same folders for children.

    An empty part is left out: for Python it means the folder it was started in.
    """
    if given := os.environ.get(SEARCH_PATH):
        parts = (os.path.abspath(part) for part in given.split(os.pathsep) if part)
        os.environ[SEARCH_PATH] = os.pathsep.join(parts)


@contextmanager
def isolated_workers() -> Generator[None]:
    """Start processes of a library, in this context, without imports from the working folder.

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
