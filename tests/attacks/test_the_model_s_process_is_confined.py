"""What parses weights and grammars has no network, no program, no file to write and no secret."""

import asyncio
import errno
import os
import subprocess
import sys
from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import replace
from pathlib import Path

import pytest
import pytest_asyncio
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.llm.engine.engine import Engine
from pa_console.llm.engine.protocol import Completed, Load, PinnedFile, Request
from pa_console.llm.engine.worker_process import Worker
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.worker import seccomp
from pa_console.llm.worker.confinement import Restriction, clean_environment, try_out
from tests.training.lora.tiny import write_tiny

LINUX = sys.platform == "linux" and os.uname().machine in seccomp.MACHINES
linux_only = pytest.mark.skipif(not LINUX, reason="this system has no filter of system calls")

ASK = Request(
    role="planner",
    system="You are a planner.",
    user="Where is the gate?",
    grammar="start: /[a-z]{6}/",
    max_tokens=8,
    deadline_s=300,
)
SECRET = "PA_TEST_TOKEN"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> LocalModel:
    path = write_tiny(tmp_path_factory.mktemp("model") / "tiny.gguf")
    return LocalModel("tiny", path, hash_file(path), "chatml", n_ctx=512)


@pytest_asyncio.fixture
async def engine(tiny: LocalModel, monkeypatch: pytest.MonkeyPatch) -> AsyncGenerator[Engine]:
    monkeypatch.setenv(SECRET, "for nobody else")
    monkeypatch.setenv("LD_PRELOAD", "")
    engine = Engine(tiny)
    yield engine
    await engine.close()


async def answer(engine: Engine, request: Request) -> Completed:
    async with aclosing(engine.generate(request)) as items:
        async for item in items:
            if isinstance(item, Completed):
                return item
    raise AssertionError("no Completed came")


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
    assert len(tried) == 3


def test_a_confinement_that_does_not_hold_is_named_by_doctor() -> None:
    from pa_console.cli.doctor.checks import confinement_words  # noqa: PLC0415

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
}
SCRIPT = """\
import ctypes, os, platform, resource, socket, subprocess, sys
from pa_console.llm.worker.confinement import confine
assert not any(item.missing for item in confine(0, 1))
libc = ctypes.CDLL(None, use_errno=True)
def call_or_raise(x86, arm, *arguments):
    number = x86 if platform.machine() == "x86_64" else arm
    if libc.syscall(number, *arguments) < 0:
        raise OSError(ctypes.get_errno(), "refused")
def call(number, *arguments):
    call_or_raise(number, number, *arguments)
mine = sys.argv[1]
for attempt in sys.argv[2:]:
    try:
        eval(attempt)
        print("done")
    except (OSError, MemoryError, ValueError) as error:
        print("refused")
"""


@linux_only
def test_what_a_process_that_was_taken_over_would_do_is_refused(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.write_text("as it was")
    before = mine.stat().st_ctime_ns
    command = (sys.executable, "-P", "-c", SCRIPT, str(mine), *ATTEMPTS.values())
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = dict(zip(ATTEMPTS, ended.stdout.split(), strict=True))
    assert [name for name, said in answers.items() if said != "refused"] == []
    assert (mine.read_text(), mine.stat().st_ctime_ns) == ("as it was", before)
    assert os.listdir(tmp_path) == ["mine"]


@linux_only
def test_what_the_model_needs_is_not_refused() -> None:
    script = (
        "import threading, numpy\n"
        "from pa_console.llm.worker.confinement import confine\n"
        "confine(0, 1)\n"
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


@settings(deadline=None)
@given(MACHINES, st.integers(0, 0x1FF), st.tuples(*[st.integers(0, 2**64 - 1)] * 6))
def test_the_filter_decides_every_call_as_its_tables_say(
    machine: seccomp.Machine, number: int, arguments: tuple[int, ...]
) -> None:
    answer = run(seccomp.program(machine, PID), asked(number, machine.audit, arguments))
    low = [value & 0xFFFFFFFF for value in arguments]
    tables = {machine.number(call) for call in seccomp.REFUSED}
    of = {
        name: machine.number(getattr(seccomp, name))
        for name in ("OPEN", "OPENAT", "CLONE", "TGKILL", "PRLIMIT")
    }
    if number in tables:
        wanted = REFUSED
    elif number in {machine.number(call) for call in seccomp.WITH_OLDER_WAY}:
        wanted = MISSING
    else:
        refused = (
            (number == of["OPEN"] and low[1] & seccomp.WRITING)
            or (number == of["OPENAT"] and low[2] & seccomp.WRITING)
            or (number == of["CLONE"] and not low[0] & seccomp.NEW_THREAD)
            or (number == of["TGKILL"] and low[0] != PID)
            or (number == of["PRLIMIT"] and low[0] != 0)
        )
        wanted = REFUSED if refused else seccomp.ALLOW
    assert answer == wanted


@settings(deadline=None)
@given(MACHINES, st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_no_call_of_another_abi_gets_through(
    machine: seccomp.Machine, number: int, architecture: int
) -> None:
    code = seccomp.program(machine, PID)
    if architecture != machine.audit:
        assert run(code, asked(number, architecture)) == REFUSED
    if machine.name == "x86_64":
        assert run(code, asked(number | seccomp.X32, machine.audit)) == REFUSED


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
    monkeypatch.setattr("pa_console.llm.engine.worker_process.COMMAND", ("-c", script))
    ended: list[str] = []

    def never_ready(_n_ctx: int, _description: str) -> None:
        raise AssertionError

    weights = PinnedFile(path=str(tiny.path), sha256=tiny.sha256)
    load = Load(weights=weights, chat="chatml", n_ctx=512, threads=1)
    worker = await Worker.spawn(load, never_ready, ended.append)
    try:
        assert await asyncio.wait_for(worker.ready, 300) is False
        assert ended == [""]
    finally:
        await worker.kill()
