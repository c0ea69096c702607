"""Child processes that run this Python without importing code from the working folder.

Python looks for modules first in the folder in which it was started. An empty part of a path, as in
`LD_LIBRARY_PATH=:/opt/lib`, means that folder too. The folder may hold files from other people: it
may be a download, a clone or a shared disk.
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
    """Make the user's PYTHONPATH absolute, so that it means the same folders in child processes.

    Empty parts are left out, because Python takes them for the folder in which it was started.
    """
    if given := os.environ.get(SEARCH_PATH):
        parts = (os.path.abspath(part) for part in given.split(os.pathsep) if part)
        os.environ[SEARCH_PATH] = os.pathsep.join(parts)


@contextmanager
def isolated_workers() -> Generator[None]:
    """Keep processes started in the `with` block from importing from the working folder.

    This includes processes that libraries start. `multiprocessing`, which Dask also uses, passes
    the environment on to its processes, but not an option such as `-P`.
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
