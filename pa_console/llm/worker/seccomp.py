"""A seccomp filter for a process that computes: no network, no other program, no change to files.

The filter is a small program that the kernel runs at every system call (Linux, x86-64 and ARM64);
once installed nothing can take it off. What is not named here stays allowed: it is a list of what
is refused. libseccomp would write the same program, but is no Python package: it would have to be
on the machine.
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
"""Where `struct seccomp_data` has what a call is; the low half of an argument comes first."""

SET_FILTER, ALL_THREADS, KEEP_SPECULATION = 1, 1, 4
"""Speculation in the CPU stays as it is: giving it up would slow the model's arithmetic."""

SET_NO_NEW_PRIVILEGES = 38
X32 = 0x40000000
"""Numbers of calls from here on are those of a second ABI of x86-64, which nothing here uses."""

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
NEW_THREAD = 0x00010000
"""What `clone` is told for a thread; without it, it makes a process."""


class Call(NamedTuple):
    """A system call: its number on x86-64 and on ARM64, where it may not exist."""

    name: str
    x86_64: int | None
    aarch64: int | None


NETWORK = (
    Call("socket", 41, 198),
    Call("socketpair", 53, 199),
    Call("connect", 42, 203),
    Call("bind", 49, 200),
    Call("listen", 50, 201),
    Call("accept", 43, 202),
    Call("accept4", 288, 242),
    Call("sendto", 44, 206),
    Call("sendmsg", 46, 211),
    Call("sendmmsg", 307, 269),
    Call("io_uring_setup", 425, 425),
)
PROCESSES = (
    Call("execve", 59, 221),
    Call("execveat", 322, 281),
    Call("fork", 57, None),
    Call("vfork", 58, None),
    Call("ptrace", 101, 117),
    Call("process_vm_readv", 310, 270),
    Call("process_vm_writev", 311, 271),
    Call("pidfd_open", 434, 434),
    Call("pidfd_send_signal", 424, 424),
    Call("pidfd_getfd", 438, 438),
    Call("kill", 62, 129),
    Call("tkill", 200, 130),
    Call("rt_sigqueueinfo", 129, 138),
    Call("rt_tgsigqueueinfo", 297, 240),
)
FILES = (
    Call("creat", 85, None),
    Call("truncate", 76, 45),
    Call("ftruncate", 77, 46),
    Call("fallocate", 285, 47),
    Call("unlink", 87, None),
    Call("unlinkat", 263, 35),
    Call("rename", 82, None),
    Call("renameat", 264, 38),
    Call("renameat2", 316, 276),
    Call("mkdir", 83, None),
    Call("mkdirat", 258, 34),
    Call("rmdir", 84, None),
    Call("link", 86, None),
    Call("linkat", 265, 37),
    Call("symlink", 88, None),
    Call("symlinkat", 266, 36),
    Call("mknod", 133, None),
    Call("mknodat", 259, 33),
    Call("chmod", 90, None),
    Call("fchmod", 91, 52),
    Call("fchmodat", 268, 53),
    Call("fchmodat2", 452, 452),
    Call("chown", 92, None),
    Call("lchown", 94, None),
    Call("fchown", 93, 55),
    Call("fchownat", 260, 54),
    Call("utime", 132, None),
    Call("utimes", 235, None),
    Call("futimesat", 261, None),
    Call("utimensat", 280, 88),
    Call("setxattr", 188, 5),
    Call("lsetxattr", 189, 6),
    Call("fsetxattr", 190, 7),
    Call("removexattr", 197, 14),
    Call("lremovexattr", 198, 15),
    Call("fremovexattr", 199, 16),
    Call("open_by_handle_at", 304, 265),
)
KERNEL = (
    Call("mount", 165, 40),
    Call("umount2", 166, 39),
    Call("pivot_root", 155, 41),
    Call("chroot", 161, 51),
    Call("unshare", 272, 97),
    Call("setns", 308, 268),
    Call("bpf", 321, 280),
    Call("perf_event_open", 298, 241),
    Call("userfaultfd", 323, 282),
    Call("add_key", 248, 217),
    Call("request_key", 249, 218),
    Call("keyctl", 250, 219),
    Call("init_module", 175, 105),
    Call("finit_module", 313, 273),
    Call("kexec_load", 246, 104),
)
REFUSED = NETWORK + PROCESSES + FILES + KERNEL

OPEN, OPENAT = Call("open", 2, None), Call("openat", 257, 56)
CLONE, TGKILL, PRLIMIT = (
    Call("clone", 56, 220),
    Call("tgkill", 234, 131),
    Call("prlimit64", 302, 261),
)
WITH_OLDER_WAY = (Call("openat2", 437, 437), Call("clone3", 435, 435))
"""Their arguments are out of a filter's sight. As if the kernel had none, so libc takes the older
call, whose arguments are looked at."""


@dataclass(frozen=True)
class Machine:
    """What a filter has to know of a kind of CPU; `seccomp` is the number of that call."""

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


def restrict() -> str:
    """Install the filter for every thread of this process; return why not, '' when it is there.

    No thread can gain privileges from then on either: the kernel asks for that first.
    """
    machine = MACHINES.get(os.uname().machine) if sys.platform == "linux" else None
    if machine is None or sys.maxsize < 1 << 32 or sys.byteorder != "little":
        return "no filter of system calls for this system"
    library = ctypes.CDLL(None, use_errno=True)
    if library.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
        return f"the kernel keeps no privileges out: {os.strerror(ctypes.get_errno())}"
    code = program(machine, os.getpid())
    array = (Instruction * len(code))(*code)
    whole = _Program(len(code), array)
    for flags in (ALL_THREADS | KEEP_SPECULATION, ALL_THREADS):
        if library.syscall(machine.seccomp, SET_FILTER, flags, ctypes.byref(whole)) == 0:
            return ""
    return f"the kernel takes no filter of system calls: {os.strerror(ctypes.get_errno())}"


def program(machine: Machine, pid: int) -> list[Instruction]:
    """Return the filter for the process `pid` on `machine`."""
    refuse, missing = _fail(errno.EACCES), _fail(errno.ENOSYS)
    code = [
        _load(ARCHITECTURE_AT),
        Instruction(EQUAL, 1, 0, machine.audit),
        refuse,
        _load(NUMBER_AT),
    ]
    if machine.name == "x86_64":
        code += [Instruction(AT_LEAST, 0, 1, X32), refuse]
    for calls, answer in ((REFUSED, refuse), (WITH_OLDER_WAY, missing)):
        for call in calls:
            if (number := machine.number(call)) is not None:
                code += [Instruction(EQUAL, 0, 1, number), answer]
    code += _by_argument(machine, OPEN, 1, [Instruction(ANY_BIT, 0, 1, WRITING), refuse])
    code += _by_argument(machine, OPENAT, 2, [Instruction(ANY_BIT, 0, 1, WRITING), refuse])
    code += _by_argument(machine, CLONE, 0, [Instruction(ANY_BIT, 1, 0, NEW_THREAD), refuse])
    code += _by_argument(machine, TGKILL, 0, [Instruction(EQUAL, 1, 0, pid), refuse])
    code += _by_argument(machine, PRLIMIT, 0, [Instruction(EQUAL, 1, 0, 0), refuse])
    return [*code, Instruction(RETURN, 0, 0, ALLOW)]


def _by_argument(
    machine: Machine, call: Call, argument: int, test: Sequence[Instruction]
) -> list[Instruction]:
    """Return what decides about `call` by the low half of an argument."""
    number = machine.number(call)
    if number is None:
        return []
    body = [_load(ARGUMENTS_AT + 8 * argument), *test, Instruction(RETURN, 0, 0, ALLOW)]
    return [Instruction(EQUAL, 0, len(body), number), *body]


def _load(offset: int) -> Instruction:
    return Instruction(LOAD, 0, 0, offset)


def _fail(code: int) -> Instruction:
    return Instruction(RETURN, 0, 0, FAIL | code)
