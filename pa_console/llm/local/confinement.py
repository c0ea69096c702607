"""The confinement of the model's process: it can read its files, compute and answer its parent.

Large C and C++ libraries parse the GGUF file and compile the grammar. If an attacker exploits a
vulnerability in them, the process still cannot use the network, start programs, write files, read
files other than Python's and the model's, access other processes, find keys in its environment, or
take more memory than the model needs. The model runs on the CPU, because GPU devices are files that
are opened for writing, which is forbidden too. `python -m pa_console.llm.local.confinement` tests
all of this.
"""

import ctypes
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from pa_console.child_processes import OWN_FOLDER, python_command
from pa_console.llm.local import seccomp
from pa_console.schema.base import StrictModel

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""The numbers of the system calls, the same on every kind of CPU."""
EXECUTE, READ_FILE, READ_FOLDER = 1 << 0, 1 << 2, 1 << 3
BENEATH = 1
"""The kind of rule that applies to a file, or to a folder and everything in it."""
SET_NO_NEW_PRIVILEGES = 38

KEPT_VARIABLES = frozenset((
    "PATH", "HOME", "LANG", "LC_ALL", "LC_CTYPE", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH",
    "SYSTEMROOT", "PYTHONPATH", "PYTHONHOME", "PYTHONUSERBASE", "PYTHONNOUSERSITE",
    "PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX", "OMP_NUM_THREADS", "OMP_PLACES",
    "OMP_PROC_BIND", "OMP_WAIT_POLICY", "GOMP_CPU_AFFINITY", "GOMP_SPINCOUNT",
    "OPENBLAS_NUM_THREADS",
))  # fmt: skip
"""The environment variables that the process may have: for Python, its libraries, the language and
the placement of threads. None of them is secret."""

OPEN_FILES = 64
WORK_BYTES = 2 << 30
"""The memory for Python, its libraries and a grammar; a 135M model was measured to use 0.3 GB."""

WEIGHTS_TIMES = 3
"""The memory for the model, as a multiple of the size of its weights. With 4096 tokens per role,
the caches of a 7B model take at most twice the size of its weights.
"""

THREAD_BYTES = 16 << 20
PACKAGE = str(Path(__file__).parents[2])
BINDING = frozenset(("OMP_PLACES", "OMP_PROC_BIND", "GOMP_CPU_AFFINITY"))
"""Variables that bind threads to cores."""
STATUS, MAPS = Path("/proc/self/status"), Path("/proc/self/maps")
OF_THE_SYSTEM = (
    "/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/share/zoneinfo",
    "/etc/ld.so.cache", "/etc/localtime", "/dev/null", "/dev/urandom", "/proc/self", "/proc/stat",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/sys", "/sys/devices/system", "/sys/fs/cgroup",
)  # fmt: skip
"""System files that Python and the C library read while the model runs."""
TRIAL_LIMIT_S = 30.0
REMEDY = "Linux 5.13 or newer with Landlock, on x86-64 or ARM64, enforces all restrictions"


class _Ruleset(ctypes.Structure):
    """The first version of `struct landlock_ruleset_attr`: the rights that need a rule."""

    _fields_ = [("handled", ctypes.c_uint64)]


class _Rule(ctypes.Structure):
    """The `struct landlock_path_beneath_attr` of the kernel."""

    _pack_ = 1
    _fields_ = [("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32)]


def restrict_reading(readable: Iterable[str | os.PathLike[str]]) -> str:
    """Restrict reading to `readable` files and folders; return the reason if that fails, else ''.

    The restriction applies to this thread and to threads that it starts later. Missing files are
    skipped.
    """
    if sys.platform != "linux":
        return "reading can be restricted only on Linux"
    library = ctypes.CDLL(None, use_errno=True)
    rights = _Ruleset(EXECUTE | READ_FILE | READ_FOLDER)
    ruleset = library.syscall(CREATE_RULESET, ctypes.byref(rights), ctypes.sizeof(rights), 0)
    if ruleset < 0:
        return f"the kernel has no Landlock: {os.strerror(ctypes.get_errno())}"
    try:
        for path in readable:
            with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
                _allow_reading(library, ruleset, path)
        if library.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0 and (
            library.syscall(RESTRICT_SELF, ruleset, 0) == 0
        ):
            return ""
        return f"the kernel refuses the Landlock rules: {os.strerror(ctypes.get_errno())}"
    finally:
        os.close(ruleset)


def _allow_reading(library: ctypes.CDLL, ruleset: int, path: str | os.PathLike[str]) -> None:
    """Add a rule that allows reading `path`; raises OSError if that fails."""
    parent = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        rights = READ_FILE | (READ_FOLDER if Path(path).is_dir() else 0)
        rule = _Rule(rights, parent)
        if library.syscall(ADD_RULE, ruleset, BENEATH, ctypes.byref(rule), 0) != 0:
            raise OSError(ctypes.get_errno(), "Landlock accepts no rule for it", os.fspath(path))
    finally:
        os.close(parent)


class Restriction(StrictModel):
    """A restriction of the process; `missing` is the reason if it does not hold, else ''."""

    what: str
    missing: str = ""


def gaps(restrictions: Iterable[Restriction]) -> str:
    """Return the restrictions that do not hold, with the reasons; '' if all hold."""
    return "; ".join(f"{item.what} ({item.missing})" for item in restrictions if item.missing)


def require_all(restrictions: Iterable[Restriction]) -> None:
    """Raise ValueError, which lists the gaps, unless all `restrictions` hold."""
    if missing := gaps(restrictions):
        raise ValueError(
            "--require-sandbox: the model's process is not confined on this machine; not "
            f"enforced: {missing}; {REMEDY}"
        )


def clean_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of `environment` that the model's process may have."""
    return {name: value for name, value in environment.items() if name in KEPT_VARIABLES}


def read_only(files: Iterable[str]) -> Restriction:
    """Give up access to other processes and to all files except Python's own and `files`.

    The restriction is permanent. It must be set before a second thread is started, because running
    threads are not restricted.
    """
    return Restriction(
        what="no reading of other files, no access to other processes",
        missing=restrict_reading((*files, *_python_files(), *OF_THE_SYSTEM)),
    )


def _python_files() -> Iterator[str]:
    """Yield the folders of this Python, of its imports, and of the libraries that it loads."""
    yield from (sys.prefix, sys.base_prefix, *filter(None, sys.path), PACKAGE)
    if sys.pycache_prefix:
        yield sys.pycache_prefix
    yield from filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep))
    if MAPS.exists():
        lines = MAPS.read_text(encoding="utf-8", errors="replace").splitlines()
        paths = {line.split(maxsplit=5)[-1] for line in lines if ".so" in line}
        yield from {os.path.dirname(path) for path in paths if path.startswith("/")}


def confine(weights_bytes: int, threads: int) -> tuple[Restriction, ...]:
    """Permanently give up everything that a process with weights of this size does not need.

    Call this after the libraries are imported and before any part of a model is parsed. Returns the
    restrictions, including those that cannot be set here.
    """
    return (
        Restriction(what="limited memory", missing=_limit_memory(weights_bytes, threads)),
        Restriction(what="few open files, no growing files", missing=_limit_files()),
        Restriction(
            what="no network, no other programs, no changes to files",
            missing=seccomp.restrict(pinned=not BINDING.isdisjoint(os.environ)),
        ),
    )


def _limit_memory(weights_bytes: int, threads: int) -> str:
    """Limit the writable memory; the weights are mapped read-only and do not count."""
    if sys.platform != "linux":
        return "memory can be limited only on Linux"
    import resource  # noqa: PLC0415 - Unix only

    used = _data_bytes()
    more = WORK_BYTES + WEIGHTS_TIMES * weights_bytes + THREAD_BYTES * threads
    return _limit(resource.RLIMIT_DATA, used + more)


def _limit_files() -> str:
    """Limit the number of open files, forbid writing to files, and disable core dumps."""
    if sys.platform == "win32":
        return "Windows has no limits on files"
    import resource  # noqa: PLC0415 - Unix only

    return (
        _limit(resource.RLIMIT_CORE, 0)
        or _limit(resource.RLIMIT_FSIZE, 0)
        or _limit(resource.RLIMIT_NOFILE, OPEN_FILES)
    )


def _limit(kind: int, value: int) -> str:
    import resource  # noqa: PLC0415 - Unix only

    hard = resource.getrlimit(kind)[1]
    least = value if hard == resource.RLIM_INFINITY else min(value, hard)
    try:
        resource.setrlimit(kind, (least, least))
    except (OSError, ValueError) as error:
        return str(error)
    return ""


def _data_bytes() -> int:
    """Return the private memory of the process; 0 if it is unknown."""
    try:
        lines = STATUS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmData:")), 0)


class _Trial(StrictModel):
    """The restrictions of a confined process, and the forbidden acts that it could still do."""

    restrictions: tuple[Restriction, ...]
    done: tuple[str, ...]


def try_out() -> tuple[Restriction, ...]:
    """Confine a process like the model's on this machine, and return its restrictions.

    If a forbidden act succeeds, it is returned as a restriction that does not hold. This takes
    0.3 s.
    """
    try:
        ended = subprocess.run(
            python_command("-m", "pa_console.llm.local.confinement"),
            cwd=OWN_FOLDER,
            capture_output=True,
            stdin=subprocess.DEVNULL,
            env=clean_environment(os.environ),
            timeout=TRIAL_LIMIT_S,
            check=True,
        )
        trial = _Trial.model_validate_json(ended.stdout)
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        return (Restriction(what="confinement", missing=f"it could not be tested: {error}"),)
    worked = (Restriction(what=done, missing="tried, and not refused") for done in trial.done)
    return (*trial.restrictions, *worked)


def _try() -> _Trial:
    """Confine this process, then attempt every forbidden act."""
    restrictions = (read_only(()), *confine(0, 1))
    if any(item.missing for item in restrictions):
        return _Trial(restrictions=restrictions, done=())
    attempts: dict[str, Callable[[], object]] = {
        "a socket": socket.socket,
        "another program": lambda: subprocess.run("true", cwd=OWN_FOLDER, check=False),
        "a file to write": lambda: open(os.devnull, "wb").close(),
        "its parent's memory": lambda: open(f"/proc/{os.getppid()}/mem", "rb").close(),
        "a folder that is not its own": lambda: os.listdir(OWN_FOLDER),
        "unlimited memory": lambda: bytearray(2 * WORK_BYTES),
    }
    done: list[str] = []
    for name, attempt in attempts.items():
        try:
            attempt()
        except (OSError, MemoryError):
            continue
        done.append(name)
    return _Trial(restrictions=restrictions, done=tuple(done))


if __name__ == "__main__":
    sys.stdout.write(_try().model_dump_json())
