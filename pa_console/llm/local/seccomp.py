"""A seccomp filter for a process that computes: no network, no other program, no change to files.

The filter is a small program that the kernel runs at every system call (Linux, x86-64 and ARM64);
once installed nothing can take it off. It is a list of what is allowed: a call that is not named
here does not exist for the process, as if the kernel were an older one. The list has what Python
and llama.cpp were seen to use, and what the versions of the C library use in its place.
libseccomp would write the same program, but is no Python package: it would have to be on the
machine.
"""

import ctypes
import errno
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
"""Opcodes of classic BPF: load a word, three jumps that compare it with a constant, return."""

ALLOW, FAIL = 0x7FFF0000, 0x00050000
NUMBER_AT, ARCHITECTURE_AT, ARGUMENTS_AT = 0, 4, 16
"""The offsets in `struct seccomp_data`; the low half of an argument comes first."""

SET_FILTER, ALL_THREADS, KEEP_SPECULATION = 1, 1, 4
"""Speculation in the CPU stays as it is: giving it up would slow the model's arithmetic."""

SET_NO_NEW_PRIVILEGES = 38
X32 = 0x40000000
"""Numbers of calls from here on are those of a second ABI of x86-64, which nothing here uses."""

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
NEW_THREAD = 0x00010000
"""The flags of `clone` for a thread; without them, it makes a process."""
WRITE, EXECUTE, ANONYMOUS = 2, 4, 0x20
"""Protection of memory, and the flag of memory that is of no file."""
NAMES_OF_THREADS = (15, 16)
"""Options of `prctl` that set and get a thread's name."""
OF_DESCRIPTORS = (0, 1, 2, 3, 1030)
"""Commands of `fcntl` that duplicate a descriptor or read its flags; none makes it send signals."""
OF_FILES = (0x5401, 0x5450, 0x5451)
"""Requests of `ioctl`: settings of a terminal, and whether a file is closed at `exec`."""


class Call(NamedTuple):
    """A system call: its number on x86-64 and on ARM64, where it may not exist."""

    name: str
    x86_64: int | None
    aarch64: int | None


THREADS = (
    Call("futex", 202, 98), Call("sched_yield", 24, 124), Call("sched_getaffinity", 204, 123),
    Call("getcpu", 309, 168), Call("set_robust_list", 273, 99), Call("rseq", 334, 293),
    Call("membarrier", 324, 283), Call("gettid", 186, 178), Call("exit", 60, 93),
    Call("exit_group", 231, 94),
)  # fmt: skip
MEMORY = (
    Call("munmap", 11, 215), Call("mremap", 25, 216), Call("madvise", 28, 233),
    Call("brk", 12, 214),
)  # fmt: skip
FILES = (
    Call("read", 0, 63), Call("readv", 19, 65), Call("pread64", 17, 67), Call("preadv", 295, 69),
    Call("write", 1, 64), Call("writev", 20, 66), Call("lseek", 8, 62), Call("close", 3, 57),
    Call("close_range", 436, 436), Call("dup", 32, 23), Call("dup2", 33, None),
    Call("dup3", 292, 24), Call("stat", 4, None), Call("lstat", 6, None), Call("fstat", 5, 80),
    Call("newfstatat", 262, 79), Call("statx", 332, 291), Call("statfs", 137, 43),
    Call("fstatfs", 138, 44), Call("access", 21, None), Call("faccessat", 269, 48),
    Call("faccessat2", 439, 439), Call("readlink", 89, None), Call("readlinkat", 267, 78),
    Call("getdents64", 217, 61), Call("getcwd", 79, 17), Call("fadvise64", 221, 223),
)  # fmt: skip
WAITING = (
    Call("poll", 7, None), Call("ppoll", 271, 73), Call("select", 23, None),
    Call("pselect6", 270, 72), Call("epoll_create1", 291, 20), Call("epoll_ctl", 233, 21),
    Call("epoll_wait", 232, None), Call("epoll_pwait", 281, 22), Call("nanosleep", 35, 101),
    Call("clock_nanosleep", 230, 115), Call("clock_gettime", 228, 113),
    Call("clock_getres", 229, 114), Call("gettimeofday", 96, 169), Call("time", 201, None),
    Call("times", 100, 153),
)  # fmt: skip
SIGNALS = (
    Call("rt_sigaction", 13, 134), Call("rt_sigprocmask", 14, 135), Call("rt_sigreturn", 15, 139),
    Call("rt_sigpending", 127, 136), Call("sigaltstack", 131, 132),
    Call("restart_syscall", 219, 128),
)  # fmt: skip
ITSELF = (
    Call("getpid", 39, 172), Call("getppid", 110, 173), Call("getuid", 102, 174),
    Call("geteuid", 107, 175), Call("getgid", 104, 176), Call("getegid", 108, 177),
    Call("uname", 63, 160), Call("sysinfo", 99, 179), Call("getrusage", 98, 165),
    Call("getpriority", 140, 141), Call("getrandom", 318, 278),
)  # fmt: skip
ALLOWED = THREADS + MEMORY + FILES + WAITING + SIGNALS + ITSELF

OPEN, OPENAT = Call("open", 2, None), Call("openat", 257, 56)
MMAP, MPROTECT = Call("mmap", 9, 222), Call("mprotect", 10, 226)
CLONE, TGKILL, PRLIMIT = (
    Call("clone", 56, 220),
    Call("tgkill", 234, 131),
    Call("prlimit64", 302, 261),
)
PRCTL, FCNTL, IOCTL = Call("prctl", 157, 167), Call("fcntl", 72, 25), Call("ioctl", 16, 29)
PIN = Call("sched_setaffinity", 203, 122)
"""Binds threads to cores, also those of other processes: allowed only if the environment asks for
bound threads."""


@dataclass(frozen=True)
class Machine:
    """The facts of a CPU kind for a filter; `seccomp` is the number of that call."""

    name: str
    audit: int
    seccomp: int

    def number(self, call: Call) -> int | None:
        """Return the number of `call`."""
        return call.x86_64 if self.name == "x86_64" else call.aarch64


MACHINES = {
    "x86_64": Machine("x86_64", 0xC000003E, 317),
    "aarch64": Machine("aarch64", 0xC00000B7, 277),
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
    """`struct sock_fprog`."""

    _fields_ = [("length", ctypes.c_uint16), ("first", ctypes.POINTER(Instruction))]


def restrict(*, pinned: bool = False) -> str:
    """Install the filter for every thread of this process; return why not, '' when it is there.

    Threads that are `pinned` may be bound to cores. No thread can gain privileges from then on
    either: the kernel asks for that first.
    """
    machine = MACHINES.get(os.uname().machine) if sys.platform == "linux" else None
    if machine is None or sys.maxsize < 1 << 32 or sys.byteorder != "little":
        return "no filter of system calls for this system"
    library = ctypes.CDLL(None, use_errno=True)
    if library.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
        return f"the kernel keeps no privileges out: {os.strerror(ctypes.get_errno())}"
    code = program(machine, os.getpid(), pinned=pinned)
    array = (Instruction * len(code))(*code)
    whole = _Program(len(code), array)
    for flags in (ALL_THREADS | KEEP_SPECULATION, ALL_THREADS):
        if library.syscall(machine.seccomp, SET_FILTER, flags, ctypes.byref(whole)) == 0:
            return ""
    return f"the kernel takes no filter of system calls: {os.strerror(ctypes.get_errno())}"


def program(machine: Machine, pid: int, *, pinned: bool = False) -> list[Instruction]:
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
    machine: Machine, call: Call, argument: int, test: Sequence[Instruction]
) -> list[Instruction]:
    """Return what decides about `call` by the low half of an argument."""
    number = machine.number(call)
    if number is None:
        return []
    body = [_load(ARGUMENTS_AT + 8 * argument), *test]
    return [Instruction(EQUAL, 0, len(body), number), *body]


def _one_of(values: Sequence[int]) -> list[Instruction]:
    """Return what allows these values alone."""
    tests = [(Instruction(EQUAL, 0, 1, value), _return(ALLOW)) for value in values]
    return [*(step for test in tests for step in test), _fail(errno.EACCES)]


def _load(offset: int) -> Instruction:
    return Instruction(LOAD, 0, 0, offset)


def _fail(code: int) -> Instruction:
    return _return(FAIL | code)


def _return(answer: int) -> Instruction:
    return Instruction(RETURN, 0, 0, answer)
