"""No export destroys a log, its head, its index, a signature, a key or a witness."""

from pathlib import Path

import pytest

from pa_console.export.source_log import whole_file
from pa_console.session.log.session_index import INDEX_NAME
from pa_console.session.log.signed_head import head_path, read_head
from pa_console.session.log.verification import verify
from pa_console.signing import KEY_VARIABLE, load_signer
from tests.cli.inside import Call
from tests.session.tamper import write_signed


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a signed log, with another one beside it, an index, a key and a witness."""
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key.pem"))
    signer = load_signer()
    write_signed(tmp_path / "other.jsonl", "S2", signer)
    path = write_signed(tmp_path / "s.jsonl", signer=signer)
    (tmp_path / INDEX_NAME).write_bytes(b"{}\n")
    (tmp_path / "known-keys").write_bytes(b"")
    (tmp_path / "house.yaml.sig").write_bytes(b"{}")
    (tmp_path / "witness").write_bytes(head_path(path).read_bytes())
    (tmp_path / "old.jsonl").write_bytes(path.read_bytes())
    (tmp_path / "s.jsonl.torn").write_bytes(b"{")
    (tmp_path / "link.md").symlink_to(head_path(path))
    return path


PARTS = (
    "s.jsonl", "s.jsonl.head", "s.jsonl.HEAD", "s.jsonl.head.new", "s.jsonl.torn", "other.jsonl",
    "other.jsonl.head", "old.jsonl", INDEX_NAME, "key.pem", "known-keys", "house.yaml.sig",
    "witness", "link.md",
)  # fmt: skip


@pytest.mark.parametrize("part", PARTS)
def test_an_export_onto_a_part_of_the_audit_is_refused(log: Path, part: str) -> None:
    target = log.with_name(part)
    before = {path: path.read_bytes() for path in log.parent.iterdir()}
    with (
        pytest.raises(ValueError, match=r"never overwritten|log itself") as told,
        whole_file(target, log) as file,
    ):
        file.write(b"export")
    assert str(target) in str(told.value)
    assert {path: path.read_bytes() for path in log.parent.iterdir()} == before


def test_the_verb_leaves_the_seal_whole(log: Path, call: Call) -> None:
    for part in ("s.jsonl.head", "other.jsonl", "key.pem"):
        done = call("export", "markdown", str(log), "-o", str(log.with_name(part)))
        assert done.code == 2
        assert "never overwritten" in done.said
    done = call("world", "generate", "-o", str(head_path(log)), "--force")
    assert (done.code, "never overwritten" in done.said) == (2, True)
    assert read_head(log) is not None
    assert verify(log).intact


def test_other_files_are_written_over_as_ever(log: Path) -> None:
    target = log.with_name("mission.md")
    for text in (b"one", b"two"):
        with whole_file(target, log) as file:
            file.write(text)
        assert target.read_bytes() == text
