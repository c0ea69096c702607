"""Landlock: a process reads only the files that are named, and nothing of other processes.

The restriction holds for the thread that asks for it and for all threads that it starts later. The
kernel then also refuses access to the memory, environment and open files of every process outside
the restriction.
"""

import ctypes
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Numbers of the system calls, on every kind of CPU."""
EXECUTE, READ_FILE, READ_FOLDER = 1 << 0, 1 << 2, 1 << 3
BENEATH = 1
"""The kind of a rule: for a file, or for a folder with everything in it."""
SET_NO_NEW_PRIVILEGES = 38


class _Ruleset(ctypes.Structure):
    """`struct landlock_ruleset_attr` of the first version: rights that need a rule."""

    _fields_ = [("handled", ctypes.c_uint64)]


class _Rule(ctypes.Structure):
    """`struct landlock_path_beneath_attr`."""

    _pack_ = 1
    _fields_ = [("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32)]


def restrict(readable: Iterable[str | os.PathLike[str]]) -> str:
    """Restrict reading to `readable` files and folders; return the reason if that fails, else ''.

    It holds for this thread and those that it starts later. Missing files are left out.
    """
    if sys.platform != "linux":
        return "the limit on files that are read is one of Linux"
    library = ctypes.CDLL(None, use_errno=True)
    wanted = _Ruleset(EXECUTE | READ_FILE | READ_FOLDER)
    ruleset = library.syscall(CREATE_RULESET, ctypes.byref(wanted), ctypes.sizeof(wanted), 0)
    if ruleset < 0:
        return f"the kernel has no Landlock: {os.strerror(ctypes.get_errno())}"
    try:
        for path in readable:
            with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
                _allow(library, ruleset, path)
        if library.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0 and (
            library.syscall(RESTRICT_SELF, ruleset, 0) == 0
        ):
            return ""
        return f"the kernel takes no Landlock: {os.strerror(ctypes.get_errno())}"
    finally:
        os.close(ruleset)


def _allow(library: ctypes.CDLL, ruleset: int, path: str | os.PathLike[str]) -> None:
    """Add the rule that `path` may be read; raises OSError if it cannot be."""
    parent = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        rights = READ_FILE | (READ_FOLDER if Path(path).is_dir() else 0)
        rule = _Rule(rights, parent)
        if library.syscall(ADD_RULE, ruleset, BENEATH, ctypes.byref(rule), 0) != 0:
            raise OSError(ctypes.get_errno(), "no rule of Landlock for it", os.fspath(path))
    finally:
        os.close(parent)
