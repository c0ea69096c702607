"""`python -m tests.session.seek_table` measures seeking in a synthetic log of a million events.

In the same run, plain refolding of a part of it is timed and scaled to the whole. CPU time is what
the seek itself takes; the wall time also counts what else the machine was doing.
"""

import argparse
import json
import os
import random
import tempfile
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median, quantiles
from time import perf_counter, process_time

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.session.log.chain import read_log
from pa_console.session.log_index import index_path
from pa_console.session.recording import Player, Recording
from pa_console.session.state import SessionState
from tests.session.story import START, at, session_started, story
from tests.tui.site import picture, track

PICTURES = 60
"""Telemetry between two events of a mission's story, as in a session that is mostly watched."""

ASSETS = 3
STEP_S = 0.5
PAGE = os.sysconf("SC_PAGE_SIZE")


def cycle(number: int) -> Iterator[ev.Event]:
    """Yield one mission from intake to end, with telemetry of some assets in between."""
    name, tick = f"M{number}", 0
    findings = tuple(
        Finding(rule_id=f"R-{n:02}", priority="high", status="complies", message="holds")
        for n in range(30)
    )
    for event in story()[3:-1]:
        data = event.data
        if isinstance(data, ev.MissionReceived):
            mission = Mission(id=name, text=f"mission {number}", created=START)
            data = ev.MissionReceived(mission=mission, position=0)
        if data.transient or data.kind == "telemetry":
            continue
        yield at(0.0, data, name)
        if data.kind == "plan_proposed":
            prompt = "a line of what the planner is told\n" * 60
            yield at(
                0.0,
                ev.PromptBuilt(role="planner", attempt=1, system=prompt, user=prompt, seconds=0.1),
                name,
            )
            yield at(0.0, ev.PlanChecked(attempt=1, findings=findings, seconds=0.1), name)
        for _ in range(PICTURES):
            tick += 5
            whole = picture(time_s=300.0 + tick / 10, tracks=(track(),))
            few = {name: whole.assets[name] for name in list(whole.assets)[:ASSETS]}
            seen = whole.model_copy(update={"assets": few})
            yield at(0.0, ev.TelemetryReceived(picture=seen))


def write_log(path: Path, events: int) -> None:
    """Write a log of so many events; its chain is not linked, which a replay does not look at."""
    bodies = [
        (
            event.data.kind,
            event.mission,
            json.dumps(event.data.model_dump(mode="json", exclude={"kind"})),
        )
        for event in cycle(0)
    ]
    start, zeros = datetime(2026, 3, 1, tzinfo=UTC), "0" * 64
    first = json.dumps(session_started().model_dump(mode="json", exclude={"kind"}))
    with path.open("w", encoding="utf-8") as file:
        for count in range(events):
            number, place = divmod(count - 1, len(bodies))
            kind, mission, data = bodies[place] if count else ("session_started", None, first)
            named = f"M{number}" if mission else None
            t = (start + timedelta(seconds=count * STEP_S)).isoformat(timespec="microseconds")
            data = data.replace('"M0"', f'"M{number}"') if kind == "mission_received" else data
            file.write(
                f'{{"seq":{count + 1},"t":"{t[:-6]}Z","tick":{count * 5},"session":"S1",'
                f'"mission":{json.dumps(named)},"kind":"{kind}","data":{data},'
                f'"prev":"{zeros}","hash":"{zeros}"}}\n'
            )


def resident_mb() -> float:
    """Return the memory of this process, in MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Return the wall and the CPU time that `work` takes, in ms."""
    wall, cpu = perf_counter(), process_time()
    work()
    return 1000 * (perf_counter() - wall), 1000 * (process_time() - cpu)


def row(what: str, times: list[tuple[float, float]]) -> None:
    """Print a line of the table."""
    wall, cpu = ([pair[n] for pair in times] for n in (0, 1))
    p95 = [
        quantiles(one, n=20, method="inclusive")[-1] if len(one) > 1 else one[0]
        for one in (wall, cpu)
    ]
    print(
        f"{what:34} wall {median(wall):9.1f} {p95[0]:9.1f} {max(wall):9.1f}"
        f"   CPU {median(cpu):9.1f} {p95[1]:9.1f} {max(cpu):9.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--events", type=int, default=1_000_000)
    parser.add_argument("--seeks", type=int, default=200)
    parser.add_argument("--refold", type=int, default=20_000, help="events that are refolded")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        log, cache = Path(name, "long.jsonl"), Path(name, "cache")
        write_log(log, given.events)
        print(f"{given.events} events, {log.stat().st_size / 1e6:.0f} MB")
        before = resident_mb()
        build = timed(lambda: Recording.read(log, cache=cache))
        kept = index_path(cache, log).stat().st_size / 1e6
        print(f"index {kept:.0f} MB; memory while it was made: {resident_mb() - before:.0f} MB")
        print(f"{'ms':34}      {'median':>9} {'95 %':>9} {'most':>9}")
        row("open, index made", [build])
        row("open, index kept", [timed(lambda: Recording.read(log, cache=cache)) for _ in range(5)])
        player = Player(Recording.read(log, cache=cache))
        chosen = random.Random(1)
        places = [chosen.randrange(1, given.events + 1) for _ in range(given.seeks)]
        row("seek to a random event", [timed(lambda n=n: player.to_event(n - 1)) for n in places])
        row("one event back", [timed(player.step_back) for _ in range(50)])
        row(
            "one simulated second back", [timed(lambda: player.step_seconds(-1)) for _ in range(50)]
        )
        print(f"memory of the opened recording: {resident_mb() - before:.0f} MB")

        def refold() -> None:
            state = SessionState()
            for count, event in enumerate(read_log(log), start=1):
                state.apply(event)
                if count == given.refold:
                    break

        wall, cpu = timed(refold)
        share = given.events / 2 / given.refold
        row(f"refolding {given.refold} events", [(wall, cpu)])
        row("so half of the log by refolding", [(wall * share, cpu * share)])


if __name__ == "__main__":
    main()
