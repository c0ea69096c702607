"""Fetches a model from the model hub through huggingface_hub, the optional extra `hub`."""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

from pa_console.llm.room import most_bytes, require_room
from pa_console.llm.sources import HubSource
from pa_console.llm.watched import run_watched

Progress = Callable[[int, int, str], None]

SCRIPT = """\
import sys
from huggingface_hub import constants, get_session, hf_hub_download
repo, name, revision, folder = sys.argv[1:]
get_session().head(constants.ENDPOINT, timeout=8)
hf_hub_download(repo, name, revision=revision, local_dir=folder)
"""
ENVIRONMENT = {
    "HF_HUB_DISABLE_PROGRESS_BARS": "1",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "HF_HUB_DISABLE_XET": "1",
    "HF_HUB_ETAG_TIMEOUT": "5",
    "HF_HUB_DOWNLOAD_TIMEOUT": "15",
}
"""Plain HTTP, which resumes a broken file, and time-outs that give the next source its turn."""

STALL_S = 40.0


def hub_missing() -> bool:
    """Return whether the extra is not installed."""
    return importlib.util.find_spec("huggingface_hub") is None


def fetch_from_hub(source: HubSource, place: Path, total: int, progress: Progress) -> Path:
    """Return the file of `source` under the folder `place`, resuming an earlier attempt.

    `total` is the expected size in bytes. Raises PullError, after 40 s without a byte at the
    latest.
    """
    place.mkdir(parents=True, exist_ok=True)
    require_room(place, total)
    run_watched(
        [sys.executable, "-c", SCRIPT, source.repo, source.file, source.revision, str(place)],
        environment=ENVIRONMENT,
        folder=place,
        report=lambda size: progress(min(size, total), total, source.label),
        stall_s=STALL_S,
        most=most_bytes(2 * total),
    )
    return place / source.file
