"""What `doctor` looks at beside the libraries: settings, model, folders, terminal, memory."""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from pa_console.cli.doctor_checks import Check
from pa_console.cli.doctor_model import check_files
from pa_console.llm.cache import cache_folder
from pa_console.llm.catalog import Catalog
from pa_console.llm.errors import ModelError
from pa_console.llm.threads import physical_cores
from pa_console.private_files import loose
from pa_console.schema.document import DocumentError
from pa_console.session.chain import LogError
from pa_console.session.index_check import check_index
from pa_console.session.log import default_folder
from pa_console.settings.folders import nearest_existing, unwritable
from pa_console.settings.sources import (
    Loaded,
    default_settings,
    load_settings,
    unknown_variables,
)
from pa_console.signing import SigningError, key_path, known_keys
from pa_console.tui.words import count

LEAST_FREE_MB = 200
WORK_MB = 700
"""Memory for the console, the simulation and a prompt's cache beside the model's weights."""

COMFORTABLE, LEAST = (80, 24), (60, 18)
MEMORY = Path("/proc/meminfo")


def load_or_default() -> tuple[Loaded, Check]:
    """Return the settings, the defaults when they cannot be used, and what there is to say."""
    from pa_console.tui.settings_check import problems  # noqa: PLC0415 - the screen's libraries

    remedy = "correct it, or go back to the defaults: pa-console settings reset"
    try:
        loaded = load_settings()
    except DocumentError as error:
        return default_settings(), Check("settings", "missing", str(error), remedy)
    wrong = [str(loaded.error(field, why)) for field, why in problems(loaded.values)]
    if wrong:
        return loaded, Check("settings", "missing", "; ".join(wrong), remedy)
    if unknown := unknown_variables():
        why = f"nothing reads {', '.join(unknown)}"
        return loaded, Check("settings", "warning", why, "see 'pa-console settings show'")
    there = "" if loaded.document is not None else ", not there: the defaults are in force"
    return loaded, Check("settings", "ok", f"{loaded.path}{there}")


def check_model(name: str) -> Iterator[Check]:
    """Look whether the model `name` (empty: the default one) is here, its hashes and its memory."""
    try:
        catalog = Catalog.load()
        entry = catalog.get(name or catalog.default)
    except (ModelError, DocumentError) as error:
        yield Check("model", "missing", str(error), "choose another: pa-console models list")
        return
    yield check_files(entry)
    yield check_memory(entry.size_mb)


def check_memory(model_mb: int, memory: Path = MEMORY) -> Check:
    """Look whether the memory that is free holds a model of `model_mb`, and at the cores."""
    cores, needed = physical_cores(), model_mb + WORK_MB
    said = count(cores, "core")
    try:
        lines = dict(line.split(":", 1) for line in memory.read_text(encoding="ascii").splitlines())
        free_mb = int(lines["MemAvailable"].split()[0]) // 1024
    except (OSError, KeyError, ValueError):
        return Check("memory, cores", "ok", f"{said}; how much memory is free cannot be told here")
    found = f"{free_mb} MB free, {needed} MB needed, {said}"
    if free_mb < needed:
        remedy = "close other programs, or choose a smaller model: pa-console models list"
        return Check("memory, cores", "warning", found, remedy)
    if cores < 2:
        return Check("memory, cores", "warning", found, "expect long answers: two cores help")
    return Check("memory, cores", "ok", found)


def check_folders(loaded: Loaded) -> Iterator[Check]:
    """Look whether config, logs, cache and key can be written, and how much room is left."""
    for name, folder, field in (
        ("config folder", loaded.path.parent, "PA_CONSOLE_SETTINGS"),
        ("log folder", loaded.values.logs or default_folder(), "pa-console settings set logs"),
        ("cache folder", cache_folder(), "pa-console settings set cache"),
        ("signing key", key_path().parent, "pa-console settings set signing_key"),
    ):
        yield check_folder(name, folder, field)


def check_sessions(folder: Path) -> Check:
    """Look whether every session of the index in `folder` is there, whole, and nobody else's."""
    name, remedy = "session logs", "bring them back from a copy; --verify of a log tells more"
    try:
        found = check_index(folder, known_keys())
    except (LogError, SigningError) as error:
        return Check(name, "warning", str(error), "look at that file")
    if found.told:
        return Check(name, "warning", "; ".join(found.told), remedy)
    if others := loose(folder):
        words = f"{folder}: others may look into it (mode {others:04o})"
        return Check(name, "warning", words, f"chmod 700 '{folder}'")
    return Check(name, "ok", f"{count(len(found.sessions), 'session')} in the index, none is lost")


def check_folder(name: str, folder: Path, field: str) -> Check:
    """Look at one folder; `field` is how another one is chosen."""
    remedy = f"give yourself the right to write there, or choose another one: {field}"
    if why := unwritable(folder):
        return Check(name, "missing", f"{folder}: {why}", remedy)
    free_mb = shutil.disk_usage(nearest_existing(folder)).free // 1_000_000
    found = f"{folder}, {free_mb} MB free"
    if free_mb < LEAST_FREE_MB:
        state = "warning" if free_mb else "missing"
        return Check(name, state, found, f"make room there, or choose another one: {field}")
    return Check(name, "ok", found)


def check_terminal() -> Iterator[Check]:
    """Look at the terminal: size, colours, the characters it takes."""
    if not sys.stdout.isatty():
        remedy = "run doctor in the terminal that the console is to run in"
        yield Check("terminal", "warning", "output goes to no terminal", remedy)
        return
    size = shutil.get_terminal_size()
    yield check_size(size.columns, size.lines)
    yield check_colours(Console().color_system, bool(os.environ.get("NO_COLOR")))
    yield check_unicode(sys.stdout.encoding)


def check_size(columns: int, lines: int) -> Check:
    """Look whether the console fits."""
    found, remedy = f"{columns} x {lines}", "make it 80 x 24 at least, 100 x 30 for all panes"
    if columns < LEAST[0] or lines < LEAST[1]:
        return Check("terminal size", "missing", found, remedy)
    small = columns < COMFORTABLE[0] or lines < COMFORTABLE[1]
    return Check("terminal size", "warning" if small else "ok", found, remedy if small else "")


def check_colours(system: str | None, plain: bool) -> Check:
    """Look at what colours the terminal says it has; none are wanted when `plain`."""
    if plain:
        return Check("colours", "ok", "none, as NO_COLOR asks")
    good = system in ("256", "truecolor")
    remedy = "" if good else "export TERM=xterm-256color, and COLORTERM=truecolor if it has them"
    return Check("colours", "ok" if good else "warning", system or "none", remedy)


def check_unicode(encoding: str) -> Check:
    """Look whether signs like ▲ arrive."""
    good = encoding.lower().replace("-", "") == "utf8"
    remedy = "" if good else "export LANG=C.UTF-8"
    return Check("Unicode", "ok" if good else "missing", encoding, remedy)
