"""After a crash no decision and no command can be forged, cut off or left out without the key."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.schema.events import event as ev
from pa_console.session.log.signed_head import head_path, read_head
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter
from pa_console.station.station import ControlStation
from tests.rig import Rig, rig, site
from tests.scripted import ScriptedEngine, plan
from tests.session.logs import kept
from tests.session.story import story, telemetry
from tests.session.tamper import KNOWN, MINE, edited, is_signed, long_story, rehashed, relinked

__all__ = ["rig", "site"]
BINDING = ("decision_made", "command_sent", "all_stopped")


def crashed(folder: Path, events: list[ev.Event]) -> Path:
    """Return the log of a console that died after `events`, as the disk has it."""
    log, copy = folder / "live.jsonl", folder / "crashed.jsonl"
    with LogWriter(log, "S1", signer=MINE, clock=lambda: 0.0) as writer:
        for event in events:
            writer.append(event)
        copy.write_bytes(log.read_bytes())
        head_path(copy).write_bytes(head_path(log).read_bytes())
    for path in (log, head_path(log)):
        path.unlink()
    return copy


def lines_of(log: Path) -> list[bytes]:
    return log.read_bytes().splitlines(keepends=True)


def last_binding(lines: list[bytes]) -> int:
    """The line of the last record that somebody answers for; 0 without one."""
    kinds = [json.loads(line)["kind"] for line in lines]
    return max((n for n, kind in enumerate(kinds, start=1) if kind in BINDING), default=0)


def test_nothing_that_somebody_answers_for_is_unsigned_after_a_crash(tmp_path: Path) -> None:
    told = kept(long_story())
    for count in range(1, len(told) + 1):
        log = crashed(tmp_path, told[:count])
        found, last = verify(log, KNOWN), last_binding(lines_of(log))
        assert found.ok
        assert found.vouched >= last
        head = read_head(log)
        assert head is not None
        assert head.seq >= last


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_whoever_has_no_key_changes_nothing_of_it_unseen(
    tmp_path: Path, data: st.DataObject
) -> None:
    """Cuts, edits and removals anywhere up to the last decision, hashes recomputed to the end."""
    parts = st.sampled_from([event for event in story() if not event.data.transient][1:-1])
    middle = data.draw(st.lists(parts | st.floats(1, 9).map(telemetry), max_size=25))
    log = crashed(tmp_path, [story()[0], *middle])
    lines = lines_of(log)
    last = max(last_binding(lines), 1)
    at = data.draw(st.integers(1, last))
    how = data.draw(st.sampled_from(["cut", "edit", "remove", "unsign"]))
    if how == "cut":
        lines = lines[: at - 1]
    elif how == "edit":
        lines = relinked([*lines[: at - 1], rehashed(edited(lines[at - 1])), *lines[at:]], at)
    elif how == "remove":
        lines = relinked([*lines[: at - 1], *lines[at:]], at)
    else:
        lines = relinked([line for line in lines if not is_signed(line)])
    log.write_bytes(b"".join(lines))
    assert not verify(log, KNOWN).ok


def test_events_of_one_moment_take_one_signature(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    command = next(e for e in story() if isinstance(e.data, ev.CommandSent))
    with LogWriter(log, "S1", signer=MINE, clock=lambda: 0.0) as writer:
        writer.append(story()[0])
        for _ in range(8):
            writer.append(command, commit=False)
        assert writer.owes
        writer.commit()
        assert not writer.owes
        assert [is_signed(line) for line in lines_of(log)] == [False, True, *[False] * 8, True]
        writer.commit()
        assert len(lines_of(log)) == 11


def only(station: ControlStation) -> Callable[..., ControlStation]:
    """Return what opens no station but `station`."""
    return lambda *_: station


async def test_no_command_takes_effect_before_the_log_is_signed(
    tmp_path: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whenever the world moves on, every decision and command so far is signed, head included."""
    log = tmp_path / "s.jsonl"
    engine = ScriptedEngine([plan(("Drone_T04", "move_to EastGate"))])
    station = rig.station(engine)
    writer = LogWriter(log, station.session, signer=MINE, clock=lambda: 0.0)
    station.write_to(writer)
    monkeypatch.setattr(rig, "station", only(station))
    fleet, moved = station._fleet, [0]  # pyright: ignore[reportPrivateUsage]
    assert isinstance(fleet, SimulatedFleet)
    sim = fleet.checkpoint
    step = sim.step

    def watched() -> object:
        if not moved[0] % 5:
            found, head, last = verify(log, KNOWN), read_head(log), last_binding(lines_of(log))
            assert found.ok
            assert head is not None
            assert min(found.vouched, head.seq) >= last
            assert not writer.owes
        moved[0] += 1
        return step()

    monkeypatch.setattr(sim, "step", watched)
    trace = await rig.run(engine)
    assert trace.status == "verified", trace.reason
    assert moved[0] > 10
    writer.close()
    assert verify(log, KNOWN).intact
    assert last_binding(lines_of(log)) > 0
