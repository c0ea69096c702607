"""What parses weights and grammars has no network, no program, no file to write and no secret."""

import asyncio
import errno
import fcntl
import json
import os
import subprocess
import sys
import termios
from collections.abc import AsyncGenerator, Callable
from dataclasses import replace
from pathlib import Path

import pytest
import pytest_asyncio
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.llm.backend import ModelUnavailableError
from pa_console.llm.local import seccomp
from pa_console.llm.local.confinement import Restriction, clean_environment, try_out
from pa_console.llm.local.engine import Engine
from pa_console.llm.local.messages import Load, PinnedFile, Ready
from pa_console.llm.local.worker_process import Worker
from pa_console.llm.models.catalogue import LocalModel
from tests.attacks.dangerous_calls import DANGEROUS
from tests.cli.inside import Call
from tests.llm.asking import ASK, answer, local_model, tiny_model

LINUX = sys.platform == "linux" and os.uname().machine in seccomp.MACHINES
linux_only = pytest.mark.skipif(not LINUX, reason="this system has no filter of system calls")

SECRET = "PA_TEST_TOKEN"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> LocalModel:
    return tiny_model(tmp_path_factory.mktemp("model"))


@pytest_asyncio.fixture
async def engine(tiny: LocalModel, monkeypatch: pytest.MonkeyPatch) -> AsyncGenerator[Engine]:
    monkeypatch.setenv(SECRET, "for nobody else")
    monkeypatch.setenv("LD_PRELOAD", "")
    engine = Engine(tiny)
    yield engine
    await engine.close()


@linux_only
async def test_a_process_that_answers_is_confined_and_knows_no_secret(engine: Engine) -> None:
    for request in (ASK, replace(ASK, role="judge"), replace(ASK, count=3)):
        done = await answer(engine, request)
        assert done.finish == "stop"
        assert all(len(text) == 6 for text in (done.text, *done.texts) if text)
    process = Path(f"/proc/{engine.pid}")
    status = dict(
        line.split(":\t", 1) for line in process.joinpath("status").read_text().split("\n") if line
    )
    assert (status["NoNewPrivs"], status["Seccomp"]) == ("1", "2")
    for thread in (process / "task").iterdir():
        assert "Seccomp:\t2" in (thread / "status").read_text()
    limits = process.joinpath("limits").read_text().splitlines()
    hard = {line[:26].strip(): line[26:].split()[1] for line in limits[1:]}
    assert (hard["Max core file size"], hard["Max file size"]) == ("0", "0")
    assert int(hard["Max open files"]) <= 64
    assert int(hard["Max data size"]) < 8 << 30
    environment = process.joinpath("environ").read_bytes()
    assert SECRET.encode() not in environment
    assert b"LD_PRELOAD" not in environment


def test_only_what_is_named_is_left_of_the_environment() -> None:
    given_ = {"PATH": "/bin", "AWS_SECRET_ACCESS_KEY": "x", "LD_PRELOAD": "x", "LANG": "C"}
    given_ |= {"SSH_AUTH_SOCK": "x", "HTTPS_PROXY": "x", "LLAMA_CPP_LIB_PATH": "x"}
    assert clean_environment(given_) == {"PATH": "/bin", "LANG": "C"}


@linux_only
def test_all_that_is_promised_is_tried() -> None:
    tried = try_out()
    assert [item for item in tried if item.missing] == []
    assert len(tried) == 4


def test_a_confinement_that_does_not_hold_is_named_by_doctor() -> None:
    from pa_console.cli.verbs.doctor.models import confinement_words  # noqa: PLC0415

    all_well = confinement_words((Restriction(what="no network"),))
    assert (all_well.state, all_well.remedy) == ("ok", "")
    lost = confinement_words((Restriction(what="no network", missing="no filter here"),))
    assert lost.state == "warning"
    assert "no network (no filter here)" in lost.found
    assert "Linux" in lost.remedy


ATTEMPTS = {
    "an internet socket": "socket.socket()",
    "a local socket": "socket.socket(socket.AF_UNIX)",
    "a pair of sockets": "socket.socketpair()",
    "io_uring, which can open sockets": "call(425, 8, ctypes.create_string_buffer(256))",
    "another process": "os.fork()",
    "another program": "os.execv('/bin/true', ['true'])",
    "a program in a child": "subprocess.run(['/bin/true'])",
    "a program without fork": "os.posix_spawn('/bin/true', ['true'], {})",
    "a file to write": "open(mine, 'w')",
    "a file to add to": "open(mine, 'a')",
    "a new file": "open(mine + '.new', 'x')",
    "a file emptied": "os.truncate(mine, 0)",
    "a file emptied while it is opened": "os.open(mine, os.O_RDONLY | os.O_TRUNC)",
    "a file that is gone": "os.unlink(mine)",
    "a file with another name": "os.rename(mine, mine + '2')",
    "a new folder": "os.mkdir(mine + '.d')",
    "a link": "os.symlink(mine, mine + '.l')",
    "a file that all may read": "os.chmod(mine, 0o777)",
    "another time of a file": "os.utime(mine, (0, 0))",
    "its parent killed": "os.kill(os.getppid(), 9)",
    "its parent signalled by thread": "call_or_raise(234, 131, os.getppid(), os.getppid(), 0)",
    "its parent's limits": "resource.prlimit(os.getppid(), resource.RLIMIT_CORE)",
    "its parent traced": "call_or_raise(101, 117, 16, os.getppid(), 0, 0)",
    "its own limits raised": "resource.setrlimit(resource.RLIMIT_FSIZE, (1, 1))",
    "many open files": "[open('/dev/null', 'rb') for _ in range(80)]",
    "memory without bounds": "bytearray(5 << 30)",
    "its parent's memory": "open(f'/proc/{os.getppid()}/mem', 'rb')",
    "its parent's environment": "open(f'/proc/{os.getppid()}/environ', 'rb').read()",
    "its parent's open files": "os.listdir(f'/proc/{os.getppid()}/fd')",
    "its parent's priority": "os.setpriority(os.PRIO_PROCESS, os.getppid(), 19)",
    "its parent's core": "os.sched_setaffinity(os.getppid(), os.sched_getaffinity(0))",
    "its parent's place on a disk": "call_or_raise(251, 30, 1, os.getppid(), 0)",
    "signals to its parent by a pipe": "fcntl.fcntl(0, fcntl.F_SETOWN, os.getppid())",
    "a file that is not its own": "open(mine, 'rb')",
    "a folder that is not its own": "os.listdir(os.path.dirname(mine))",
    "memory that others share": "call_or_raise(29, 194, 0, 4096, 0o1600)",
    "a queue of messages": "call_or_raise(68, 186, 0, 0o1600)",
    "a semaphore that others see": "call_or_raise(64, 190, 0, 1, 0o1600)",
    "a queue with a name": "call_or_raise(240, 180, text(b'pa'), 0o100 | 2, 0o600, 0)",
    "its own priority": "os.nice(1)",
    "another way to be scheduled": "os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))",
    "a file system": "call(430, text(b'tmpfs'), 0)",
    "a tree of mounts": "call(428, -100, text(b'/'), 1)",
    "names of its own": "call_or_raise(272, 97, 0x10000000)",
    "a file in memory": "os.memfd_create('x')",
    "memory that can be run": "mmap.mmap(-1, 4096, prot=7)",
    "memory that can be run later": "run_later(4096)",
    "a file that can be changed and run": "mmap.mmap(own.fileno(), 4096, mmap.MAP_PRIVATE, 7)",
    "memory whose pages can all be run": "call_or_raise(135, 92, 0x0400000)",
    "other files watched": "call_or_raise(300, 262, 0, 0)",
    "another time of day": "time.clock_settime(time.CLOCK_REALTIME, time.time())",
    "another name of the machine": "socket.sethostname(socket.gethostname())",
    "two processes compared": "call_or_raise(312, 272, os.getpid(), os.getppid(), 0, 0, 0)",
    "another user": "os.setuid(os.getuid())",
    "a process by descriptor": "os.pidfd_open(os.getppid())",
}
INJECTED = """\
import ctypes, fcntl, json, mmap, os, platform, resource, socket, subprocess, sys, time
from pa_console.llm.local import worker
from pa_console.llm.local.messages import Done, TextPiece
from pa_console.schema.finding import Usage
own = open(sys.executable, "rb")
libc = ctypes.CDLL(None, use_errno=True)
text = ctypes.create_string_buffer
def run_later(size):
    page = mmap.mmap(-1, size)
    address = ctypes.addressof(ctypes.c_char.from_buffer(page))
    if libc.mprotect(ctypes.c_void_p(address), size, 5) < 0:
        raise OSError(ctypes.get_errno(), "refused")
def call_or_raise(x86, arm, *arguments):
    number = x86 if platform.machine() == "x86_64" else arm
    if libc.syscall(number, *arguments) < 0:
        raise OSError(ctypes.get_errno(), "refused")
def call(number, *arguments):
    call_or_raise(number, number, *arguments)
def attempted(attempt, mine):
    try:
        eval(attempt, globals(), {"mine": mine})
    except (OSError, MemoryError, ValueError):
        return "refused"
    return "done"
def answer(decoder, chat, asked, send):
    mine, attempts = asked.request.system, asked.request.user.splitlines()
    said = json.dumps([attempted(attempt, mine) for attempt in attempts])
    send(TextPiece(id=asked.id, text=said))
    return Done(id=asked.id, finish="stop", usage=Usage())
worker._answer = answer
worker.main()
"""


@linux_only
async def test_what_a_process_that_was_taken_over_would_do_is_refused(
    engine: Engine, tiny: LocalModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.llm.local.worker_process.COMMAND", ("-c", INJECTED))
    mine = tmp_path / "mine"
    mine.write_text("as it was")
    before = mine.stat().st_ctime_ns
    allowed = (f"open({str(tiny.path)!r}, 'rb')", "open(worker.__file__, 'rb')")
    attempts = "\n".join((*ATTEMPTS.values(), *allowed))
    done = await answer(engine, replace(ASK, system=str(mine), user=attempts))
    said: list[str] = json.loads(done.text)
    assert said[len(ATTEMPTS) :] == ["done"] * len(allowed), "its model, and its library"
    answers = dict(zip(ATTEMPTS, said, strict=False))
    assert [name for name, answered in answers.items() if answered != "refused"] == []
    assert (mine.read_text(), mine.stat().st_ctime_ns) == ("as it was", before)
    assert os.listdir(tmp_path) == ["mine"]


UNCONFINED = """\
from pa_console.llm.local import worker
from pa_console.llm.local.confinement import Restriction
def confine(size, threads):
    return (Restriction(what="no network", missing="no filter here"),)
worker.confine = confine
worker.main()
"""


async def test_a_model_whose_process_is_not_confined_is_ready_and_says_so(
    tiny: LocalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.llm.local.worker_process.COMMAND", ("-c", UNCONFINED))
    states: list[tuple[str, str]] = []
    engine = Engine(tiny, lambda state, detail: states.append((state, detail)))
    try:
        assert (await answer(engine, ASK)).finish == "stop"
    finally:
        await engine.close()
    assert [state for state, _ in states if state != "slow"] == ["loading", "unconfined"]
    assert "no network (no filter here)" in states[1][1]


async def test_no_model_is_loaded_without_the_confinement_that_is_required(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.llm.local.worker_process.COMMAND", ("-c", UNCONFINED))
    path = tmp_path / "never-parsed.gguf"
    path.write_bytes(b"no model: parsing it would be another error")
    engine = Engine(local_model(path), require_sandbox=True)
    try:
        with pytest.raises(ModelUnavailableError, match=r"--require-sandbox.*no filter here"):
            await answer(engine, ASK)
    finally:
        await engine.close()


@pytest.mark.parametrize(
    "words",
    ["console --plain --new", "mission Look.", "serve"],
    ids=["console", "mission", "serve"],
)
@pytest.mark.parametrize("how", ["--require-sandbox", "--set require_sandbox=on"])
def test_no_session_starts_without_the_confinement_that_is_required(
    words: str, how: str, monkeypatch: pytest.MonkeyPatch, call: Call, tiny: LocalModel
) -> None:
    lost = (Restriction(what="no network", missing="no filter here"),)
    monkeypatch.setattr("pa_console.cli.sessions.live.try_out", lambda: lost)
    before = how.split() if how.startswith("--set") else []
    after = [] if before else [how]
    done = call(*before, *words.split(), "--model", str(tiny.path), *after)
    assert done.code == 2
    assert "no network (no filter here)" in done.said
    assert "Linux 5.13" in done.said, "the remedy"


@linux_only
def test_what_the_model_needs_is_not_refused() -> None:
    script = (
        "import threading, numpy\n"
        "from pa_console.llm.local.confinement import confine, read_only\n"
        "assert not any(item.missing for item in (read_only(()), *confine(0, 1)))\n"
        "said = []\n"
        "thread = threading.Thread(target=said.append, args=(1,)); thread.start(); thread.join()\n"
        "open('/proc/self/status').read(); open(__import__('os').devnull, 'rb').read()\n"
        "import xml.dom.minidom, decimal, sqlite3\n"
        "print(said, int(numpy.ones((300, 300)).dot(numpy.ones(300)).sum()))\n"
    )
    command = (sys.executable, "-c", script)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.stdout.strip() == "[1] 90000", ended.stderr


def run(code: list[seccomp.Instruction], data: bytes) -> int:
    """Return what the kernel would answer to a call: an interpreter of classic BPF."""
    at = accumulator = 0
    while True:
        step = code[at]
        match step.code:
            case seccomp.LOAD:
                accumulator = int.from_bytes(data[step.value : step.value + 4], "little")
                at += 1
                continue
            case seccomp.RETURN:
                return step.value
            case seccomp.EQUAL:
                holds = accumulator == step.value
            case seccomp.AT_LEAST:
                holds = accumulator >= step.value
            case seccomp.ANY_BIT:
                holds = bool(accumulator & step.value)
            case unknown:
                raise AssertionError(unknown)
        at += 1 + (step.yes if holds else step.no)


def asked(number: int, architecture: int, arguments: tuple[int, ...] = ()) -> bytes:
    """Return `struct seccomp_data` of a call."""
    padded = (*arguments, *(0,) * (6 - len(arguments)))
    words = (number.to_bytes(4, "little"), architecture.to_bytes(4, "little"), bytes(8))
    return b"".join((*words, *(value.to_bytes(8, "little") for value in padded)))


PID = 4711
REFUSED, MISSING = seccomp.FAIL | errno.EACCES, seccomp.FAIL | errno.ENOSYS
MACHINES = st.sampled_from(list(seccomp.MACHINES.values()))
ARGUMENTS = st.tuples(*[st.integers(0, 2**64 - 1)] * 6)
BY_ARGUMENT: dict[str, Callable[[list[int], int], bool]] = {
    "OPEN": lambda low, _: not low[1] & seccomp.WRITING,
    "OPENAT": lambda low, _: not low[2] & seccomp.WRITING,
    "MMAP": lambda low, _: not low[2] & 4 or not (low[2] & 2 or low[3] & 0x20),
    "MPROTECT": lambda low, _: not low[2] & 4,
    "CLONE": lambda low, _: bool(low[0] & 0x10000),
    "TGKILL": lambda low, pid: low[0] == pid,
    "PRLIMIT": lambda low, _: low[0] == 0,
    "PRCTL": lambda low, _: low[0] in (15, 16),
    "FCNTL": lambda low, _: low[1] in (fcntl.F_DUPFD, fcntl.F_GETFD, fcntl.F_SETFD, fcntl.F_GETFL,
                                       fcntl.F_DUPFD_CLOEXEC),
    "IOCTL": lambda low, _: low[1] in (termios.TCGETS, termios.FIOCLEX, termios.FIONCLEX),
}  # fmt: skip
"""What the arguments of a call must be, by their low halves, for it to be allowed."""


@settings(deadline=None, max_examples=500)
@given(MACHINES, st.integers(0, 0x1FF), ARGUMENTS, st.booleans())
def test_the_filter_decides_every_call_as_its_tables_say(
    machine: seccomp.CpuKind, number: int, arguments: tuple[int, ...], pinned: bool
) -> None:
    code = seccomp.program(machine, PID, pinned=pinned)
    answer = run(code, asked(number, machine.audit, arguments))
    low = [value & 0xFFFFFFFF for value in arguments]
    looked_at = {machine.number(getattr(seccomp, name)): name for name in BY_ARGUMENT}
    allowed = {machine.number(call) for call in seccomp.ALLOWED}
    if number in looked_at:
        holds = BY_ARGUMENT[looked_at[number]](low, PID)
        assert answer == (seccomp.ALLOW if holds else REFUSED)
    elif number in allowed or (pinned and number == machine.number(seccomp.PIN)):
        assert answer == seccomp.ALLOW
    else:
        assert answer == MISSING


@pytest.mark.parametrize("name", BY_ARGUMENT)
@settings(deadline=None)
@given(MACHINES, st.sampled_from([0, 1, 2, 3, 4, 5, 7, 8, 10, 15, 16, 0x20, 0x22, 0x5401, 0x5412,
                                  0x5451, 0x10000, 0x10F00, 1030, PID]), ARGUMENTS)  # fmt: skip
def test_the_filter_looks_at_the_arguments_that_matter(
    name: str, machine: seccomp.CpuKind, likely: int, arguments: tuple[int, ...]
) -> None:
    number = machine.number(getattr(seccomp, name))
    if number is None:
        return
    for place in range(4):
        given_ = (*arguments[:place], likely, *arguments[place + 1 :])
        low = [value & 0xFFFFFFFF for value in given_]
        answer = run(seccomp.program(machine, PID), asked(number, machine.audit, given_))
        assert answer == (seccomp.ALLOW if BY_ARGUMENT[name](low, PID) else REFUSED)


@settings(deadline=None, max_examples=30)
@given(MACHINES, ARGUMENTS)
def test_no_dangerous_call_is_allowed_whatever_its_arguments(
    machine: seccomp.CpuKind, arguments: tuple[int, ...]
) -> None:
    code = seccomp.program(machine, PID)
    numbers = [
        (name, x86_64 if machine.name == "x86_64" else aarch64)
        for name, x86_64, aarch64 in DANGEROUS
    ]
    allowed = [
        name
        for name, number in numbers
        if number is not None
        and run(code, asked(number, machine.audit, arguments)) == seccomp.ALLOW
    ]
    assert allowed == []


@settings(deadline=None)
@given(MACHINES, st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_no_call_of_another_abi_gets_through(
    machine: seccomp.CpuKind, number: int, architecture: int
) -> None:
    code = seccomp.program(machine, PID)
    if architecture != machine.audit:
        assert run(code, asked(number, architecture)) == REFUSED
    if machine.name == "x86_64":
        assert run(code, asked(number | seccomp.X32, machine.audit)) == REFUSED


READER = """\
import os
from threading import Thread
from pa_console.llm.local.messages import LoadFailed, encode
from pa_console.llm.local import worker
def look(found):
    for path in (f"/proc/{os.getppid()}/mem", os.environ["HOME"]):
        try:
            os.close(os.open(path, os.O_RDONLY))
            found.append(path)
        except PermissionError:
            pass
def serve(load, inbox, outbox, reading):
    found = []
    thread = Thread(target=look, args=(found,))
    thread.start()
    thread.join()
    look(found)
    open(load.weights.path, "rb").close()
    outbox.write(encode(LoadFailed(error=f"read: {found}")))
worker.serve = serve
worker.main()
"""


@linux_only
async def test_the_worker_reads_the_weights_and_neither_its_parent_nor_its_user_s_files(
    tiny: LocalModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.llm.local.worker_process.COMMAND", ("-c", READER))
    monkeypatch.setenv("HOME", str(tmp_path))
    worker = await Worker.spawn(loading(tiny), never_ready, lambda _: None)
    try:
        assert await asyncio.wait_for(worker.ready, 300) is False
        assert worker.error == "read: []"
    finally:
        await worker.kill()


def never_ready(_loaded: Ready) -> None:
    raise AssertionError


def loading(model: LocalModel) -> Load:
    weights = PinnedFile(path=str(model.path), sha256=model.sha256)
    return Load(weights=weights, chat="chatml", n_ctx=512, threads=1)


FLOOD = """\
import sys
sys.stdin.buffer.readline()
while True:
    sys.stdout.buffer.write(b'{"op":"piece","id":1,"text":"' + b"a" * 1000 + b'"}\\n')
"""
ENDLESS_LINE = """\
import sys
sys.stdin.buffer.readline()
while True:
    sys.stdout.buffer.write(b"a" * 1000)
"""


@pytest.mark.parametrize("script", [FLOOD, ENDLESS_LINE])
async def test_a_process_that_says_more_than_it_was_asked_for_is_ended(
    script: str, tiny: LocalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.llm.local.worker_process.COMMAND", ("-c", script))
    ended: list[str] = []
    worker = await Worker.spawn(loading(tiny), never_ready, ended.append)
    try:
        assert await asyncio.wait_for(worker.ready, 300) is False
        assert ended == [""]
    finally:
        await worker.kill()
