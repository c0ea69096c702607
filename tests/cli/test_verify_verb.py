"""`pa-console replay --verify` and `--compare`."""

from datetime import timedelta
from itertools import pairwise
from pathlib import Path

import pytest

from pa_console.schema.events import event as ev
from pa_console.session.log.chain import line_of, read_log
from pa_console.session.log.signed_head import head_path
from pa_console.session.log.writer import LogWriter
from pa_console.signing import load_signer
from tests.cli.inside import Call, Done
from tests.session.story import PLAN, story
from tests.session.tamper import OTHER, edited, long_story, rehashed, relinked, write_signed


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a sound log, signed by this machine's key."""
    return write_signed(tmp_path / "s.jsonl", signer=load_signer())


def chain(call: Call, log: Path, *words: str) -> Done:
    """Verify a log without running its session again."""
    return call("replay", str(log), "--verify", "--chain-only", *words)


def test_an_intact_log_is_told_with_who_signed_it(call: Call, log: Path) -> None:
    done = chain(call, log)
    assert done.code == 0, done.err
    assert f"{log}: 37 lines, chain intact, signed by SHA256:" in done.said
    assert "the key of this machine" in done.said
    document = chain(call, log, "--json").json
    assert (document["intact"], document["ok"], document["standing"]) == (True, True, "signed")
    assert document["lines"] == document["vouched"] == 37
    assert document["key"] == load_signer().fingerprint


def test_damage_is_told_with_its_line_and_kind(call: Call, log: Path) -> None:
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join([*lines[:6], edited(lines[6]), *lines[7:]]))
    done = chain(call, log)
    assert (done.code, done.out) == (2, "")
    assert f"{log}:7: edited-field: " in done.said
    shown = chain(call, log, "--json")
    assert shown.code == 2
    assert (shown.json["damage"], shown.json["first_bad_line"]) == ("edited-field", 7)
    log.write_bytes(b"".join(relinked([rehashed(lines[0], tick=9), *lines[1:]])))
    assert f"{log}:1-2: rewritten: " in chain(call, log).said
    log.write_bytes(b"".join(lines))
    head_path(log).unlink()
    assert f"{head_path(log)}: head-missing: " in chain(call, log).said


def test_a_log_without_signatures_is_accepted_only_when_asked_for(
    call: Call, tmp_path: Path
) -> None:
    log = tmp_path / "old.jsonl"
    with LogWriter(log, "S1") as writer:
        for event in long_story():
            writer.append(event)
    done = chain(call, log)
    assert done.code == 1
    assert "chain intact, not signed" in done.said
    assert chain(call, log, "--unsigned").code == 0
    assert chain(call, log, "--json").json["intact"] is False


def test_a_log_of_another_machine_needs_the_fingerprint_of_its_key(
    call: Call, tmp_path: Path
) -> None:
    log = write_signed(tmp_path / "s.jsonl", signer=OTHER)
    done = chain(call, log, "--unsigned")
    assert done.code == 2
    assert f"{log}:2: unknown-key: signed by an unknown key, {OTHER.fingerprint}" in done.said
    known = chain(call, log, "--key", OTHER.fingerprint)
    assert known.code == 0
    assert "the key of this machine" not in known.said
    wrong = call("replay", str(log), "--verify", "--key", "mine")
    assert wrong.code == 2
    assert "--key mine: give a fingerprint, SHA256:" in wrong.said


def test_a_session_that_goes_on_is_neither_intact_nor_damaged(call: Call, tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    with LogWriter(log, "S1", signer=load_signer(), clock=lambda: 0.0) as writer:
        assert "not signed yet. The log is empty." in chain(call, log).said
        for event in long_story()[:5]:
            writer.append(event)
        writer.flush()
        done = chain(call, log)
    assert done.code == 1
    assert "only up to line 2" in done.said
    assert "4 unsigned records" in done.said


def test_a_clock_that_was_set_back_within_a_session_is_named(call: Call, tmp_path: Path) -> None:
    told = long_story()
    back = [event.model_copy(update={"t": event.t - timedelta(hours=1)}) for event in told[9:20]]
    events = [*told[:9], *back, *told[20:]]
    log = write_signed(tmp_path / "s.jsonl", signer=load_signer(), events=events)
    done = chain(call, log)
    assert done.code == 0
    back_by = timedelta(seconds=round((told[8].t - back[0].t).total_seconds()))
    number = next(
        number
        for number, (one, other) in enumerate(pairwise(read_log(log)), start=2)
        if other.t < one.t
    )
    place = f"before line {line_of(log, number)}"
    assert f"The clock was set back by {back_by} {place}" in done.said
    jumps = [*told[:9], *back, *told[20:25], *back[:2]]
    log = write_signed(tmp_path / "t.jsonl", signer=load_signer(), events=jumps)
    done = chain(call, log)
    assert f"The clock was set back 2 times, first by {back_by} {place}" in done.said


def test_a_clock_that_is_adjusted_by_less_than_a_second_is_no_remark(
    call: Call, tmp_path: Path
) -> None:
    told = long_story()
    told[9] = told[9].model_copy(update={"t": told[8].t - timedelta(milliseconds=900)})
    log = write_signed(tmp_path / "s.jsonl", signer=load_signer(), events=told)
    assert "the clock" not in chain(call, log).said.lower()


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    monkeypatch.setenv("PA_CONSOLE_CACHE", str(tmp_path / "cache"))


def written(path: Path, session: str, events: list[ev.Event]) -> str:
    with LogWriter(path, session) as writer:
        for event in events:
            writer.append(event)
    return str(path)


def changed() -> list[ev.Event]:
    """The story with another plan."""
    told = story()
    place = next(n for n, event in enumerate(told) if event.data.kind == "plan_proposed")
    data = told[place].data.model_copy(update={"plan": PLAN.model_copy(update={"reason": "why"})})
    told[place] = told[place].model_copy(update={"data": data})
    return told


def test_two_sessions_that_tell_the_same_are_the_same(call: Call, tmp_path: Path) -> None:
    a = written(tmp_path / "a.jsonl", "S1", story())
    b = written(tmp_path / "b.jsonl", "S2", story())
    done = call("replay", a, "--compare", b)
    assert done.code == 0, done.err
    assert "no differences in 16 events" in done.said
    assert call("replay", a, "--compare", b, "--json").json["same"] is True


def test_the_first_difference_is_printed_with_both_values(call: Call, tmp_path: Path) -> None:
    a = written(tmp_path / "a.jsonl", "S1", story())
    b = written(tmp_path / "b.jsonl", "S2", changed())
    done = call("replay", a, "--compare", b)
    assert done.code == 1
    assert "first difference A event 7" in done.said
    assert "plan.reason: look at the gate | why" in done.said
    shown = call("replay", a, "--compare", b, "--json")
    assert shown.code == 1
    assert shown.json["first"]["changes"][0]["path"] == "plan.reason"


def test_a_log_that_cannot_be_read_is_neither(call: Call, tmp_path: Path) -> None:
    a = written(tmp_path / "a.jsonl", "S1", story())
    rubbish, short = tmp_path / "rubbish.jsonl", tmp_path / "short.jsonl"
    rubbish.write_text("rubbish\n")
    short.write_bytes(Path(a).read_bytes() + b"rubbish\n")
    missing = tmp_path / "missing.jsonl"
    for other, named in ((rubbish, ":1:"), (short, ":17:"), (missing, "no such log")):
        done = call("replay", a, "--compare", str(other))
        assert done.code == 2
        assert named in done.err
