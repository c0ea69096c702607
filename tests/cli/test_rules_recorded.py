"""`pa-console rules effect` and `rules trace` on a recorded session."""

from pathlib import Path

import pytest

from pa_console.session.log.writer import LogWriter
from tests.cli.inside import Call
from tests.evaluation.sessions import RECON
from tests.policy.book import RULES
from tests.station.test_effect import recorded

STRICT = """
  - id: ROE-99
    domain: ROE
    priority: high
    text: "Nobody looks."
    check: "!actions.exists(a, a.verb == 'observe')"
    message: "somebody looks"
workflows:"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a log, a file that is none, and a stricter rule set."""
    path = tmp_path_factory.mktemp("recorded")
    with LogWriter(path / "one.jsonl", "S1") as writer:
        for event in recorded(RECON):
            writer.append(event)
    (path / "answers.jsonl").write_text('{"answer": 1}\n')
    (path / "strict.yaml").write_text(RULES.read_text().replace("\nworkflows:", STRICT, 1))
    return path


def test_what_turns_is_listed_and_told_by_the_exit_code(call: Call, folder: Path) -> None:
    log, strict = str(folder / "one.jsonl"), str(folder / "strict.yaml")
    same = call("rules", "effect", "checkpoint", str(folder))
    assert (same.code, same.err) == (0, "")
    assert "sessions 1, missions 1, plans 1" in same.out
    assert "turned: none; cannot be checked again: 0" in same.out
    done = call("rules", "effect", strict, log)
    assert done.code == 1
    assert f"{log}: session" in done.out
    assert "attempt 1 [Drone_T04 observe WestGate]: plan ROE-99: not blocked -> blocked" in done.out
    assert "turned: 1 finding, 1 plan, 1 decision" in done.out
    document = call("rules", "effect", strict, log, "--json").json
    assert document["turned"] == {"ROE-99": 3}
    assert [flip["kind"] for flip in document["sessions"][log]["flips"]] == [
        "finding", "plan", "decision"
    ]  # fmt: skip


def test_what_cannot_be_read_is_told(call: Call, folder: Path, tmp_path: Path) -> None:
    for words in (
        (str(folder / "answers.jsonl"),),
        (str(tmp_path),),
        (str(tmp_path / "none.jsonl"),),
        (),
        ("--missions", "nowhere"),
    ):
        done = call("rules", "effect", "checkpoint", *words)
        assert done.code == 2
        assert done.err


def test_a_log_cut_short_is_gone_through_up_to_there(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.jsonl"
    cut.write_bytes((folder / "one.jsonl").read_bytes()[:-20])
    done = call("rules", "effect", str(folder / "strict.yaml"), str(cut))
    assert done.code == 2
    assert "turned: 1 finding, 1 plan, 1 decision" in done.out
    assert f"{cut}: not read to its end" in done.err
    assert call("rules", "trace", "ROE-01", str(cut)).code == 2


def test_missions_of_a_set_are_tried_with_single_orders(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    few = tmp_path / "few.yaml"
    few.write_text("name: few\nmissions:\n  - {id: A1, category: c, command: Look around.}\n")
    idle = tmp_path / "idle.yaml"
    text = (folder / "strict.yaml").read_text()
    idle.write_text(text.replace("!actions.exists(a, a.verb == 'observe')", "size(actions) == 0"))
    words = ("rules", "effect", str(idle), "--missions", str(few), "--plans", "8", "--seed", "1")
    done = call(*words)
    assert done.code == 1
    assert "[no orders]" not in done.out
    assert done.out.count("finding ROE-99: no such rule -> violates (high)") == 8
    assert "plan ROE-99: not blocked -> blocked: ROE-99: somebody looks" in done.out
    assert "missions 1, plans 9" in done.out
    assert call(*words).out == done.out


def test_a_rule_is_followed_to_its_missions(call: Call, folder: Path) -> None:
    done = call("rules", "trace", "ROE-01", str(folder))
    assert (done.code, done.err) == (0, "")
    assert "retrieved: place" in done.out
    assert "attempt 1: decided" in done.out
    assert (
        "ROE-01, missions: retrieved in 1, decided in 1, broken in 0, prescribed in 0; "
        "sessions searched: 1" in done.out
    )
    document = call("rules", "trace", "ROE-01", str(folder), "--json").json
    (trails,) = document["sessions"].values()
    assert {entry["did"] for entry in trails[0]["entries"]} >= {"retrieved", "decided"}
    assert call("rules", "trace", "ROE-77", str(folder)).code == 1
    assert call("rules", "trace", "ROE-01", str(folder / "strict.yaml")).code == 2
