"""One session, or one change of keys, whose process is killed at a line, and what is left of it.

The station, its log, its index and its keys are the real ones; only the LLM is scripted. What is
put on the link is written to a pipe at once, so it is known whatever happens to the process. A
session goes on in a new process as a console resumes it, until one of them ends in order.
"""

import asyncio
import json
import os
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import aclosing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any, cast

from pa_console.fleets.authorization import public_of
from pa_console.fleets.key_folder import KeyFolder
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.approval import standing_approver
from pa_console.schema.command import STILL, DeviceCommand
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.session.log.chain import LogError, read_log
from pa_console.session.log.session_index import check_index
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter, open_session_log
from pa_console.session.past_sessions import summarise
from pa_console.session.state import SessionState, begun_missions
from pa_console.signing import KEY_VARIABLE, SigningError, known_keys, load_signer
from pa_console.station.assembly import open_station
from pa_console.station.earlier.unclosed_session import NotResumableError, find_unclosed, resume
from pa_console.station.station import ControlStation
from tests.attacks.crash_lines import REACHED, Line, die_at
from tests.attacks.stop_trial import LiveClock, checkpoint
from tests.scripted import ScriptedEngine, plan

ORDERS = (
    plan(("Drone_T04", "move_to EastGate"), ("Ugv_T02", "report")),
    plan(("Drone_T04", "move_to SouthGate")),
    plan(("Ugv_T02", "move_to NorthGate")),
)
QUICK = Variant(name="crash", rehearsal=False, checks=False, method="bm25")
LOGS, KEY, KEYS = "logs", "key.pem", "site-keys"
MOST_LIVES = 3
AGAIN = 0.3
"""How often a session that goes on is killed once more."""


class Wire:
    """The end of a pipe that a process writes facts to, each as one line."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def put(self, **fact: object) -> None:
        """Write one fact; it is in the pipe when this returns."""
        os.write(self._descriptor, json.dumps(fact).encode() + b"\n")


class WiredFleet(SimulatedFleet):
    """A simulated fleet that writes to the wire what is put on the link, before it is."""

    wire: Wire

    def send(self, command: DeviceCommand) -> None:
        """Write it to the wire, then put it on the link."""
        self.wire.put(sent=command.command_id, verb=command.verb)
        super().send(command)


@dataclass
class Found:
    """What came of trials: kills by line, lives, and everything that must not be."""

    trials: int = 0
    kills: Counter[Line] = field(default_factory=Counter[Line])
    not_reached: int = 0
    resumed: int = 0
    torn: int = 0
    sent: int = 0
    held: int = 0
    problems: list[str] = field(default_factory=list[str])

    def add(self, other: "Found") -> None:
        """Count what `other` found as well."""
        for name in ("trials", "not_reached", "resumed", "torn", "sent", "held"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.kills += other.kills
        self.problems += other.problems

    def summary(self) -> str:
        """Return all of it in words."""
        return (
            f"{self.trials} trials, {self.kills.total()} kills at {len(self.kills)} lines "
            f"({self.not_reached} not reached), {self.resumed} sessions resumed, {self.torn} torn "
            f"ends set aside, {self.sent} commands on the link, {self.held} interrupted missions "
            f"named and held; problems: {len(self.problems)}"
        )


def child(act: Callable[[Wire], None], line: Line | None, times: int) -> tuple[bool, list[Any]]:
    """Run `act` in a process of its own, killed at `line`; return if it was, and what it wrote."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(reading)
            die_at(line, times)
            act(Wire(writing))
            code = 0
        finally:
            os._exit(code)
    os.close(writing)
    with open(reading, "rb") as stream:
        facts = [json.loads(fact) for fact in stream.read().splitlines()]
    _, status = os.waitpid(pid, 0)
    if not os.WIFSIGNALED(status) and os.WEXITSTATUS(status):
        facts.append({"failed": os.WEXITSTATUS(status)})
    return os.WIFSIGNALED(status), facts


def counted(act: Callable[[Wire], None]) -> Counter[Line]:
    """Return how often `act` reaches each line."""

    def counting(wire: Wire) -> None:
        act(wire)
        for line, times in REACHED.counts.copy().items():
            wire.put(module=line.module, number=line.number, times=times)

    _, facts = child(counting, None, 0)
    lines = [fact for fact in facts if "module" in fact]
    return Counter({Line(fact["module"], fact["number"]): fact["times"] for fact in lines})


class SessionTrial:
    """A session in `folder` that is killed and resumed."""

    def __init__(self, folder: Path, seed: int, *, power: bool = False) -> None:
        """With `power`, the disk also loses what was not waited for, as when power fails."""
        self._folder, self._logs, self._power = folder, folder / LOGS, power
        self._random = Random(seed)
        self._seed = seed
        self.found = Found(trials=1)
        self._sent: list[tuple[int, str, str]] = []
        """Every command on the link: the number of the process, session and id, verb."""
        self._life = 0
        self._begun: set[str] = set()
        """The missions that a killed process left begun."""

    def live(self, wire: Wire) -> None:
        """Begin a session, or go on with the one that was not closed, to an end in order."""
        os.environ[KEY_VARIABLE] = str(self._folder / KEY)
        if self._power:
            _tell_of_syncs(wire)
        asyncio.run(self._live(wire))

    async def _live(self, wire: Wire) -> None:
        site, random = checkpoint(), Random(f"{self._seed} {self._life}")
        signer = load_signer()
        before = find_unclosed(self._logs, site.world_sha256)
        resumed = None
        if before is not None:
            with suppress(NotResumableError, LogError):
                resumed = resume(before, site.world, None)
            wire.put(resumed=resumed is not None)
        fleet = WiredFleet(
            (resumed.fleet if resumed else SimulatedFleet.start(site.world)).checkpoint
        )
        fleet.wire = wire
        station = open_station(
            site,
            ScriptedEngine(random.sample(ORDERS, 3)).engine(),
            LiveClock(),
            variant=QUICK,
            fleet=fleet,
            read_unasked=False,
            resumed=replace(resumed, fleet=fleet) if resumed else None,
        )
        log = resumed.before.log if resumed else None
        wire.put(session=station.session)
        with open_session_log(
            station.session,
            signer,
            path=log,
            folder=self._logs,
            on_error=_fail,
            resumed=log is not None,
        ) as writer:
            await _drive(station, writer, random)

    def run(self, lines: Counter[Line]) -> Found:
        """Kill and resume it; `lines` are where it can be killed, and how often each is reached."""
        os.environ[KEY_VARIABLE] = str(self._folder / KEY)
        for self._life in range(MOST_LIVES):
            last = self._life == MOST_LIVES - 1
            wanted = not last and (self._life == 0 or self._random.random() < AGAIN)
            line = self._random.choice(sorted(lines)) if wanted else None
            times = self._random.randint(1, lines[line]) if line else 0
            kept = {str(path): path.stat().st_size for path in self._growing()}
            killed, facts = child(self.live, line, times)
            self._take(facts)
            if line and killed:
                self.found.kills[line] += 1
                if self._power:
                    self._lose_unsynced(kept, facts)
                self._look_after_kill()
            elif line:
                self.found.not_reached += 1
            if not killed:
                break
        self._look_at_end()
        return self.found

    def _take(self, facts: list[Any]) -> None:
        session = ""
        for fact in facts:
            if "sent" in fact:
                self._sent.append((self._life, f"{session} {fact['sent']}", fact["verb"]))
                self.found.sent += 1
            elif "session" in fact:
                session = fact["session"]
            elif "resumed" in fact:
                self.found.resumed += fact["resumed"]
                if not fact["resumed"]:
                    self._problem("the session cannot go on")
            elif "failed" in fact:
                self._problem(f"process {self._life} failed")

    def _problem(self, text: str) -> None:
        self.found.problems.append(f"seed {self._seed}: {text}")

    def _growing(self) -> list[Path]:
        return sorted((*self._logs.glob("*.jsonl"), *self._logs.glob("*.index")))

    def _lose_unsynced(self, kept: dict[str, int], facts: list[Any]) -> None:
        """Cut each file that grows to a length between what is on the disk and what was written.

        `kept` are the lengths that were on the disk before.
        """
        synced: dict[str, int] = {}
        for fact in facts:
            if "synced" in fact:
                # Two threads wait for one disk: the one that began first may be the last to tell.
                synced[fact["synced"]] = max(fact["size"], synced.get(fact["synced"], 0))
        kept |= synced
        for path in self._growing():
            size = path.stat().st_size
            least = min(size, kept.get(str(path), 0))
            os.truncate(path, self._random.randint(least, size))

    def _look_after_kill(self) -> None:
        """Look at the logs as they are after a kill."""
        for log in sorted(self._logs.glob("*.jsonl")):
            result = verify(log)
            if not result.ok:
                if result.damage == "half-line":
                    self.found.torn += 1
                else:
                    self._problem(f"after a kill {log.name}: {result.damage}: {result.problem}")
        found = find_unclosed(self._logs, checkpoint().world_sha256)
        if found is not None:
            self._begun |= {trace.mission.id for trace in found.interrupted}

    def _look_at_end(self) -> None:
        """Look at what the last process, which ended in order, has left."""
        logged: Counter[str] = Counter()
        again: Counter[str] = Counter()
        for log in sorted(self._logs.glob("*.jsonl")):
            result = verify(log)
            if result.damage == "half-line" and not result.lines:
                continue  # power failed within its first record: no session had begun
            if not result.ok:
                self._problem(f"at the end {log.name}: {result.damage}: {result.problem}")
                continue
            state = SessionState()
            for event in read_log(log):
                state.apply(event)
                match event.data:
                    case ev.CommandSent(command=command):
                        logged[f"{result.session} {command.command_id}"] += 1
                    case ev.CommandResent(command_id=name):
                        again[f"{result.session} {name}"] += 1
                    case _:
                        pass
            self._look_at_missions(log, state)
        for problem in check_index(self._logs, known_keys()).all_problems:
            self._problem(f"index: {problem}")
        self._look_at_link(logged, again)

    def _look_at_missions(self, log: Path, state: SessionState) -> None:
        if not state.missions:
            return
        named = {mission.id for mission in summarise(log).missions if mission.status is None}
        for trace in begun_missions(state):
            if trace.mission.id not in named:
                self._problem(f"{log.name}: {trace.mission.id} has no end, and is not named")
        for name in self._begun & set(state.missions):
            status = state.missions[name].status
            self.found.held += status == "held"
            if status != "held":
                self._problem(f"{log.name}: {name} was interrupted, and ended as {status}")

    def _look_at_link(self, logged: Counter[str], again: Counter[str]) -> None:
        times: Counter[str] = Counter()
        lives: dict[str, set[int]] = {}
        for life, name, verb in self._sent:
            times[name] += 1
            lives.setdefault(name.partition(".")[0], set()).add(life)
            if name not in logged and verb not in STILL:
                self._problem(f"{name} {verb} was sent, and no log has it")
        for name, sent in times.items():
            if sent > 1 + again[name]:
                self._problem(f"{name} was sent {sent} times")
        for mission, of in lives.items():
            if len(of) > 1:
                self._problem(f"{mission} sent commands before and after a kill")


def _fail(error: LogError) -> None:
    raise error


def _tell_of_syncs(wire: Wire) -> None:
    """Write to the wire which file is on the disk, and how much of it, after each wait."""
    sync = os.fsync

    def told(file: int) -> None:
        size = os.fstat(file).st_size
        sync(file)
        wire.put(synced=os.readlink(f"/proc/self/fd/{file}"), size=size)

    os.fsync = cast(Any, told)


async def _drive(station: ControlStation, writer: LogWriter, random: Random) -> None:
    """Give two missions, approve them, stop everything now and then, and close in order."""
    station.write_to(writer)
    approve = standing_approver("auto")
    stop_at = random.randint(5, 60) if random.random() < 0.5 else 0
    end_at = random.randint(20, 90)
    closing: asyncio.Task[None] | None = None
    async with aclosing(station.run()) as events:
        number = 0
        async for event in events:
            number += 1
            if event.data.kind in ("session_started", "session_resumed"):
                if station.stopped:
                    station.release()
                station.submit("Move the drone to the east gate.")
                station.submit("Move the ground vehicle to the north gate.")
            if isinstance(event.data, ev.ApprovalRequested):
                with suppress(ValueError):  # nothing waits any more
                    station.decide(approve(event.data))
            if number == stop_at:
                station.stop_all()
            if number >= end_at and closing is None:
                closing = asyncio.create_task(station.close("the trial ends"))
    if closing is not None:
        await closing
    await asyncio.sleep(0)  # what the journal has put off is signed then


CHANGES: dict[str, Callable[[KeyFolder], object]] = {
    "make site": lambda folder: folder.make_site("ann", "north", {}),
    "make bob": lambda folder: folder.make_person("bob", "commander"),
    "make carl": lambda folder: folder.make_person("carl", "operator"),
    "rotate ann": lambda folder: folder.rotate("ann"),
    "rotate north": lambda folder: folder.rotate("north"),
    "take over": lambda folder: folder.take_over("north"),
    "revoke ann": lambda folder: folder.revoke("ann"),
    "rotate bob": lambda folder: folder.rotate("bob"),
    "revoke carl": lambda folder: folder.revoke("carl"),
}
"""Changes of a site's keys, in the order in which they are made."""


def _given_up(folder: KeyFolder, change: str) -> str:
    """Return the public key that `change` is to revoke, '' for none."""
    act, _, name = change.partition(" ")
    if act not in ("rotate", "revoke"):
        return ""
    roster = folder.trust().roster
    return roster.people[name].key if name in roster.people else roster.stations[name]


class KeysTrial:
    """Changes of a site's keys in `folder`, killed once; what was interrupted is done again."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._path, self._seed, self._random = folder / KEYS, seed, Random(seed)
        self.found = Found(trials=1)

    def live(self, wire: Wire) -> None:
        """Make every change; write to the wire which has begun, and which is done."""
        folder = KeyFolder(self._path)
        for name, change in CHANGES.items():
            wire.put(begun=name, gives_up=_given_up(folder, name))
            change(folder)
            wire.put(done=name, revoked=sorted(folder.trust().revoked))

    def run(self, lines: Counter[Line]) -> Found:
        """Kill it once; `lines` are where it can be killed, and how often each is reached."""
        line = self._random.choice(sorted(lines))
        killed, facts = child(self.live, line, self._random.randint(1, lines[line]))
        if killed:
            self.found.kills[line] += 1
        else:
            self.found.not_reached += 1
        begun = [fact for fact in facts if "begun" in fact]
        done = [fact for fact in facts if "done" in fact]
        try:
            self._look(begun[len(done) :], done[-1]["revoked"] if done else [])
        except SigningError as error:
            self._problem(begun[-1]["begun"], f"the keys cannot be used: {error}")
        return self.found

    def _problem(self, change: str, text: str) -> None:
        self.found.problems.append(f"seed {self._seed}: {change}: {text}")

    def _look(self, begun: list[Any], revoked: list[str]) -> None:
        """Do the interrupted change again, which was `begun`; keys that were `revoked` stay so."""
        folder = KeyFolder(self._path)
        interrupted = [fact["begun"] for fact in begun]
        for fact in begun:
            name = fact["begun"]
            before = folder.trust() if folder.made else None
            try:
                CHANGES[name](folder)
            except ValueError as error:
                if "already" not in str(error) and "no person or station" not in str(error):
                    self._problem(name, f"it cannot be done again: {error}")
            after = folder.trust()
            if before is not None and after.roster.serial < before.roster.serial:
                self._problem(name, "the roster went back")
            if fact["gives_up"] not in {"", *after.revoked}:
                self._problem(name, "the key that was given up cannot be revoked any more")
        if not folder.made:
            return
        trust = folder.trust()
        if not set(revoked) <= trust.revoked:
            self._problem("revoke", "a revoked key is not revoked any more")
        roster = trust.roster
        keys = {name: folder.person_key(name) for name in roster.people}
        here = {public_of(key): name for name, key in keys.items()}
        here[public_of(folder.keys().station)] = "north"
        in_force = {*roster.stations.values(), *(person.key for person in roster.people.values())}
        for key, name in here.items():
            if key not in in_force:
                self._problem(", ".join(interrupted), f"the key of {name} is not the roster's")
        if in_force & trust.revoked:
            self._problem(", ".join(interrupted), "a key of the roster is revoked")


def campaign(count: int, seed: int) -> tuple[list[str], list[str]]:
    """Kill so many sessions and changes of keys; return what came of them and what was amiss.

    A quarter of the trials changes keys; in a fifth of the sessions power fails.
    """
    checkpoint()
    sessions, keys = Found(), Found()
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name)
        in_session = counted(SessionTrial(whole / "counted", seed).live)
        in_keys = counted(KeysTrial(whole / "counted", seed).live)
        for number in range(seed, seed + count):
            folder = whole / str(number)
            folder.mkdir()
            if number % 4 == 0:
                keys.add(KeysTrial(folder, number).run(in_keys))
            else:
                trial = SessionTrial(folder, number, power=number % 5 == 0)
                sessions.add(trial.run(in_session))
    told = [
        f"sessions: {sessions.summary()}; {len(in_session)} lines can be reached",
        f"keys: {keys.summary()}; {len(in_keys)} lines can be reached",
    ]
    return told, [*sessions.problems, *keys.problems]
