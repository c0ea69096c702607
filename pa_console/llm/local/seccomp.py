"""A seccomp filter for a computing process: no network, no other programs, no changes to files.

The filter is a small program that the kernel runs at every system call (Linux, x86-64 and ARM64).
Once installed, it cannot be removed. It is an allow list: a call that is not listed fails as if it
did not exist, as on an older kernel. The list has the calls that Python and llama.cpp were observed
to make, and the calls that other versions of the C library make instead of them.

libseccomp could write the same program, but it is not a Python package and would have to be
installed on the machine.
"""

import ctypes
import errno
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
"""Opcodes of classic BPF: load a word, three jumps that compare it with a constant, and return."""

ALLOW, FAIL = 0x7FFF0000, 0x00050000
NUMBER_AT, ARCHITECTURE_AT, ARGUMENTS_AT = 0, 4, 16
"""The offsets in `struct seccomp_data`. Each argument has 64 bits, with the low half first."""

SET_FILTER, ALL_THREADS, KEEP_SPECULATION = 1, 1, 4
"""The operation and the flags of the call `seccomp`. The CPU's speculation stays as it is, because
disabling it would slow the model's arithmetic."""

SET_NO_NEW_PRIVILEGES = 38
X32 = 0x40000000
"""The first call number of x32, a second ABI of x86-64 that the process does not use."""

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
NEW_THREAD = 0x00010000
"""The flag of `clone` that makes a thread; without it, `clone` makes a process."""
WRITE, EXECUTE, ANONYMOUS = 2, 4, 0x20
"""Two memory protections, and the flag for memory without a file."""
NAMES_OF_THREADS = (15, 16)
"""Options of `prctl` that set and get a thread's name."""
OF_DESCRIPTORS = (0, 1, 2, 3, 1030)
"""The commands of `fcntl` that duplicate a descriptor, read its flags, or set whether it is closed
at `exec`. None of them enables signals."""
OF_FILES = (0x5401, 0x5450, 0x5451)
"""Requests of `ioctl`: the settings of a terminal, and whether a file is closed at `exec`."""


class SystemCall(NamedTuple):
    """A system call with its numbers on x86-64 and ARM64, or None where it does not exist."""

    name: str
    x86_64: int | None
    aarch64: int | None


THREADS = (
    SystemCall("futex", 202, 98), SystemCall("sched_yield", 24, 124),
    SystemCall("sched_getaffinity", 204, 123), SystemCall("getcpu", 309, 168),
    SystemCall("set_robust_list", 273, 99), SystemCall("rseq", 334, 293),
    SystemCall("membarrier", 324, 283), SystemCall("gettid", 186, 178), SystemCall("exit", 60, 93),
    SystemCall("exit_group", 231, 94),
)  # fmt: skip
MEMORY = (
    SystemCall("munmap", 11, 215), SystemCall("mremap", 25, 216), SystemCall("madvise", 28, 233),
    SystemCall("brk", 12, 214),
)  # fmt: skip
FILES = (
    SystemCall("read", 0, 63), SystemCall("readv", 19, 65), SystemCall("pread64", 17, 67),
    SystemCall("preadv", 295, 69), SystemCall("write", 1, 64), SystemCall("writev", 20, 66),
    SystemCall("lseek", 8, 62), SystemCall("close", 3, 57), SystemCall("close_range", 436, 436),
    SystemCall("dup", 32, 23), SystemCall("dup2", 33, None), SystemCall("dup3", 292, 24),
    SystemCall("stat", 4, None), SystemCall("lstat", 6, None), SystemCall("fstat", 5, 80),
    SystemCall("newfstatat", 262, 79), SystemCall("statx", 332, 291), SystemCall("statfs", 137, 43),
    SystemCall("fstatfs", 138, 44), SystemCall("access", 21, None),
    SystemCall("faccessat", 269, 48), SystemCall("faccessat2", 439, 439),
    SystemCall("readlink", 89, None), SystemCall("readlinkat", 267, 78),
    SystemCall("getdents64", 217, 61), SystemCall("getcwd", 79, 17),
    SystemCall("fadvise64", 221, 223),
)  # fmt: skip
WAITING = (
    SystemCall("poll", 7, None), SystemCall("ppoll", 271, 73), SystemCall("select", 23, None),
    SystemCall("pselect6", 270, 72), SystemCall("epoll_create1", 291, 20),
    SystemCall("epoll_ctl", 233, 21), SystemCall("epoll_wait", 232, None),
    SystemCall("epoll_pwait", 281, 22), SystemCall("nanosleep", 35, 101),
    SystemCall("clock_nanosleep", 230, 115), SystemCall("clock_gettime", 228, 113),
    SystemCall("clock_getres", 229, 114), SystemCall("gettimeofday", 96, 169),
    SystemCall("time", 201, None), SystemCall("times", 100, 153),
)  # fmt: skip
SIGNALS = (
    SystemCall("rt_sigaction", 13, 134), SystemCall("rt_sigprocmask", 14, 135),
    SystemCall("rt_sigreturn", 15, 139), SystemCall("rt_sigpending", 127, 136),
    SystemCall("sigaltstack", 131, 132), SystemCall("restart_syscall", 219, 128),
)  # fmt: skip
ITSELF = (
    SystemCall("getpid", 39, 172), SystemCall("getppid", 110, 173), SystemCall("getuid", 102, 174),
    SystemCall("geteuid", 107, 175), SystemCall("getgid", 104, 176),
    SystemCall("getegid", 108, 177), SystemCall("uname", 63, 160), SystemCall("sysinfo", 99, 179),
    SystemCall("getrusage", 98, 165), SystemCall("getpriority", 140, 141),
    SystemCall("getrandom", 318, 278),
)  # fmt: skip
ALLOWED = THREADS + MEMORY + FILES + WAITING + SIGNALS + ITSELF

OPEN, OPENAT = SystemCall("open", 2, None), SystemCall("openat", 257, 56)
MMAP, MPROTECT = SystemCall("mmap", 9, 222), SystemCall("mprotect", 10, 226)
CLONE, TGKILL, PRLIMIT = (
    SystemCall("clone", 56, 220),
    SystemCall("tgkill", 234, 131),
    SystemCall("prlimit64", 302, 261),
)
PRCTL, FCNTL, IOCTL = (
    SystemCall("prctl", 157, 167),
    SystemCall("fcntl", 72, 25),
    SystemCall("ioctl", 16, 29),
)
PIN = SystemCall("sched_setaffinity", 203, 122)
"""The call that binds threads to cores, including threads of other processes. It is allowed only if
the environment variables bind threads."""


@dataclass(frozen=True)
class CpuKind:
    """A kind of CPU: its name, its audit number, and the number of the call `seccomp`."""

    name: str
    audit: int
    seccomp: int

    def number(self, call: SystemCall) -> int | None:
        """Return the number of `call`."""
        return call.x86_64 if self.name == "x86_64" else call.aarch64


MACHINES = {
    "x86_64": CpuKind("x86_64", 0xC000003E, 317),
    "aarch64": CpuKind("aarch64", 0xC00000B7, 277),
}


class Instruction(ctypes.Structure):
    """One instruction of classic BPF, `struct sock_filter`."""

    _fields_ = [
        ("code", ctypes.c_uint16),
        ("yes", ctypes.c_uint8),
        ("no", ctypes.c_uint8),
        ("value", ctypes.c_uint32),
    ]


class _Program(ctypes.Structure):
    """A program of classic BPF, `struct sock_fprog`."""

    _fields_ = [("length", ctypes.c_uint16), ("first", ctypes.POINTER(Instruction))]


def restrict(*, pinned: bool = False) -> str:
    """Install the filter for every thread of this process; return why it failed, or ''.

    If `pinned`, threads may be bound to cores. From then on, no thread can gain privileges, because
    the kernel accepts the filter only on this condition.
    """
    machine = MACHINES.get(os.uname().machine) if sys.platform == "linux" else None
    if machine is None or sys.maxsize < 1 << 32 or sys.byteorder != "little":
        return "system calls cannot be filtered on this system"
    library = ctypes.CDLL(None, use_errno=True)
    if library.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
        return f"the kernel cannot forbid new privileges: {os.strerror(ctypes.get_errno())}"
    code = program(machine, os.getpid(), pinned=pinned)
    array = (Instruction * len(code))(*code)
    whole = _Program(len(code), array)
    for flags in (ALL_THREADS | KEEP_SPECULATION, ALL_THREADS):
        if library.syscall(machine.seccomp, SET_FILTER, flags, ctypes.byref(whole)) == 0:
            return ""
    return f"the kernel refuses the filter of system calls: {os.strerror(ctypes.get_errno())}"


def program(machine: CpuKind, pid: int, *, pinned: bool = False) -> list[Instruction]:
    """Return the filter for the process `pid` on `machine`."""
    refuse, missing, allow = _fail(errno.EACCES), _fail(errno.ENOSYS), _return(ALLOW)
    code = [
        _load(ARCHITECTURE_AT),
        Instruction(EQUAL, 1, 0, machine.audit),
        refuse,
        _load(NUMBER_AT),
    ]
    if machine.name == "x86_64":
        code += [Instruction(AT_LEAST, 0, 1, X32), refuse]
    for call in (*ALLOWED, PIN) if pinned else ALLOWED:
        if (number := machine.number(call)) is not None:
            code += [Instruction(EQUAL, 0, 1, number), allow]
    not_writing = [Instruction(ANY_BIT, 0, 1, WRITING), refuse, allow]
    code += _by_argument(machine, OPEN, 1, not_writing)
    code += _by_argument(machine, OPENAT, 2, not_writing)
    code += _by_argument(machine, MMAP, 2, [
        Instruction(ANY_BIT, 1, 0, EXECUTE), allow,
        Instruction(ANY_BIT, 0, 1, WRITE), refuse,
        _load(ARGUMENTS_AT + 8 * 3),
        Instruction(ANY_BIT, 0, 1, ANONYMOUS), refuse, allow,
    ])  # fmt: skip
    code += _by_argument(machine, MPROTECT, 2, [Instruction(ANY_BIT, 0, 1, EXECUTE), refuse, allow])
    code += _by_argument(machine, CLONE, 0, [Instruction(ANY_BIT, 1, 0, NEW_THREAD), refuse, allow])
    code += _by_argument(machine, TGKILL, 0, _one_of((pid,)))
    code += _by_argument(machine, PRLIMIT, 0, _one_of((0,)))
    code += _by_argument(machine, PRCTL, 0, _one_of(NAMES_OF_THREADS))
    code += _by_argument(machine, FCNTL, 1, _one_of(OF_DESCRIPTORS))
    code += _by_argument(machine, IOCTL, 1, _one_of(OF_FILES))
    return [*code, missing]


def _by_argument(
    machine: CpuKind, call: SystemCall, argument: int, test: Sequence[Instruction]
) -> list[Instruction]:
    """Return instructions that decide on `call` by the low half of its argument `argument`."""
    number = machine.number(call)
    if number is None:
        return []
    body = [_load(ARGUMENTS_AT + 8 * argument), *test]
    return [Instruction(EQUAL, 0, len(body), number), *body]


def _one_of(values: Sequence[int]) -> list[Instruction]:
    """Return instructions that allow only `values`."""
    tests = [(Instruction(EQUAL, 0, 1, value), _return(ALLOW)) for value in values]
    return [*(step for test in tests for step in test), _fail(errno.EACCES)]


def _load(offset: int) -> Instruction:
    return Instruction(LOAD, 0, 0, offset)


def _fail(code: int) -> Instruction:
    return _return(FAIL | code)


def _return(answer: int) -> Instruction:
    return Instruction(RETURN, 0, 0, answer)
