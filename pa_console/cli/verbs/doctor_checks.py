"""The checks of `doctor`: Python, libraries, model, settings, folders, terminal, memory."""

import importlib
import logging
import os
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from pathlib import Path
from time import perf_counter, sleep
from typing import Literal

from rich.console import Console

from pa_console.child_processes import python_command
from pa_console.fleets.link import OWN, LinkFinding, link_schemes
from pa_console.fleets.newcomers import survey
from pa_console.fleets.vda5050.site_files import CONFIGURATION, unbound
from pa_console.llm.backend import ModelError
from pa_console.llm.local.confinement import REMEDY, Restriction, try_out
from pa_console.llm.local.threads import idle_seconds, physical_cores
from pa_console.llm.models.cache import cache_folder, hash_file
from pa_console.llm.models.catalogue import Catalog, ModelEntry, check_adapters
from pa_console.llm.models.preparing import Preparation, find_recorded
from pa_console.private_files import exposed, nearest_existing, unwritable
from pa_console.resources import install_hint
from pa_console.schema.document import DocumentError
from pa_console.schema.text import count
from pa_console.session.log.chain import LogError
from pa_console.session.log.session_index import check_index
from pa_console.session.log.writer import default_folder
from pa_console.settings.schema import Settings
from pa_console.settings.sources import (
    LoadedSettings,
    default_settings,
    load_settings,
    unknown_variables,
)
from pa_console.signing import SigningError, key_path, known_keys, site_keys
from pa_console.sim.worlds.world_file import open_world

State = Literal["ok", "warning", "missing"]
PACKAGE = "pa-console"
LOOK_S = 0.4
QUIET_SHARE = 0.2
"""Up to this share of the cores may be busy on a machine that counts as idle."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at; `remedy` is empty when all is well."""

    name: str
    state: State
    found: str
    remedy: str = ""
    details: tuple[LinkFinding, ...] = ()
    """The robots of a link, one by one."""


def check_python() -> Check:
    """Look at the interpreter."""
    found = f"{sys.version.split()[0]} in {sys.prefix}"
    good = sys.version_info >= (3, 11)
    return Check(
        "Python", "ok" if good else "missing", found, "" if good else "install 3.11 or newer"
    )


def check_build_tools() -> Iterator[Check]:
    """Look for what llama.cpp is compiled with; without it nothing is missing once that is done."""
    built = _problem_of("llama_cpp") == ""
    compilers = (os.environ.get("CXX", ""), "c++", "g++", "clang++")
    for name, commands, package in (
        ("C++ compiler", compilers, "g++"),
        ("CMake", ("cmake",), "cmake"),
    ):
        found = next((path for item in commands if item and (path := shutil.which(item))), None)
        remedy = f"install it, e.g. on Debian and Ubuntu: apt install {package}"
        if found is not None:
            yield Check(name, "ok", found)
        elif built:
            yield Check(name, "ok", "none, and none is needed: llama.cpp is built")
        else:
            yield Check(name, "missing", "none; llama.cpp has to be built", remedy)


def check_libraries() -> Iterator[Check]:
    """Import every library that the package asks for; extras are not looked at."""
    try:
        asked = requires(PACKAGE) or []
    except PackageNotFoundError:
        remedy = "install it: pip install ."
        yield Check("libraries", "missing", f"{PACKAGE} is not installed", remedy)
        return
    modules: dict[str, list[str]] = {}
    for module, names in packages_distributions().items():
        for name in names:
            modules.setdefault(_canonical(name), []).append(module)
    for line in asked:
        if "extra ==" in line:
            continue
        name = re.split(r"[^\w.-]", line)[0]
        yield _check_library(name, line, modules.get(_canonical(name), []))


def _check_library(name: str, asked: str, modules: list[str]) -> Check:
    command = python_command("-m", "pip", "install", "--force-reinstall", asked)
    remedy = f"install it again: {shlex.join(command)}"
    try:
        number = version(name)
    except PackageNotFoundError:
        return Check(name, "missing", "not installed", remedy)
    public = [module for module in modules if not module.startswith("_") and module.isidentifier()]
    for module in public:
        if problem := _problem_of(module):
            return Check(name, "missing", f"{number}, cannot be imported: {problem}", remedy)
    return Check(name, "ok", number)


def _problem_of(module: str) -> str:
    """Return why `module` cannot be imported, empty when it can."""
    logging.getLogger(module).setLevel(logging.ERROR)  # matplotlib warns of folders it cannot make
    try:
        importlib.import_module(module)
    except Exception as error:  # whatever a broken library raises when it is loaded
        return f"{type(error).__name__}: {error}"
    return ""


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


SECOND_READER = "second reader"
PINNED = "SHA-256 as the catalogue pins it"


def check_files(entry: ModelEntry) -> Check:
    """Hash every loaded file of a model, and report its comparison."""
    path, pull = entry.local_file, f"pa-console models pull {entry.name}"
    if path is None:
        return Check("model", "missing", f"{entry.name} is not here ({entry.size_mb} MB)", pull)
    try:
        digest = entry.check(path)
        adapters = check_adapters(entry.name, entry.adapters)
    except (ModelError, OSError) as error:
        return Check("model", "missing", str(error), f"rm '{path}'; {pull}")
    known = entry.sha256 is not None
    said = [f"{path}: {PINNED if known else 'no hash is known that it could be held against'}"]
    if entry.how is not None:
        good, words = _prepared(entry, entry.how, digest)
        if not good:
            return Check("model", "missing", f"{entry.name}: {words}", pull)
        said.append(words)
    if files := {item.path for item in adapters}:
        said.append(f"{count(len(files), 'adapter')}: {PINNED}")
    found = f"{entry.name}: {'; '.join(said)}"
    if not known:
        remedy = "choose a model of the catalogue that has one"
        return Check("model", "warning", found, remedy)
    return Check("model", "ok", found)


def _prepared(entry: ModelEntry, how: Preparation, source_sha256: str) -> tuple[bool, str]:
    """Return whether the prepared file may be loaded, or is yet to be made, and why."""
    path, pin = entry.prepared_file, entry.pin(how)
    held = "the catalogue's pin" if pin else "no pin: this machine's key signs its hash then"
    if path is None:
        return True, f"{how} weights: made at the first start, held against {held}"
    if pin:
        digest = hash_file(path)
        if digest == pin:
            return True, f"{path}, which is loaded: {PINNED} for {how}"
        return False, (
            f"{path}: not the {how} weights that the catalogue pins: its SHA-256 is {digest}, "
            f"pinned is {pin}; it is never loaded, the next start makes it again"
        )
    if find_recorded(entry.stem, how, source_sha256) is not None:
        return True, (
            f"{path}, which is loaded: SHA-256 as in the record that this machine's key signed "
            f"when it was made; the catalogue pins none for {how}"
        )
    return False, (
        f"{path}: no record signed with this machine's key fits it, and the catalogue pins no "
        f"{how} weights; it is never loaded, the next start makes it again"
    )


def check_confinement() -> Check:
    """Attempt in a process like the model's the acts that must be impossible."""
    return confinement_words(try_out())


def confinement_words(restrictions: tuple[Restriction, ...]) -> Check:
    """Report the confinement that holds for the model's process, and its gaps with reasons."""
    held = [item.what for item in restrictions if not item.missing]
    missing = [f"not kept from it: {i.what} ({i.missing})" for i in restrictions if i.missing]
    found = "; ".join([*missing, *held])
    if not missing:
        return Check("model's process", "ok", f"{found}; tried")
    return Check("model's process", "warning", found, REMEDY)


LEAST_FREE_MB = 200
WORK_MB = 500
"""Memory for the console, and for both models' processes beside their weights; measured: 400."""

COMFORTABLE, LEAST = (80, 24), (60, 18)
MEMORY = Path("/proc/meminfo")


def load_or_default() -> tuple[LoadedSettings, Check]:
    """Return the settings, or the defaults when they cannot be used, and their check."""
    from pa_console.tui.screens.settings import problems  # noqa: PLC0415 - the screen's libraries

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
    needed_mb = loaded_mb(entry)
    if entry.second_reader:
        second = catalog.get(entry.second_reader)
        yield check_second_reader(second)
        needed_mb += loaded_mb(second) if second.local_file else 0
    yield check_memory(needed_mb)


def loaded_mb(entry: ModelEntry) -> int:
    """Return the megabytes of the file that is loaded, of the one to be fetched if none is here."""
    file = entry.prepared_file or entry.local_file
    return entry.size_mb if file is None else file.stat().st_size // 10**6


def check_second_reader(entry: ModelEntry) -> Check:
    """Hash the model that reads unclear orders again; the console works without it."""
    if entry.local_file is None:
        pull = f"pa-console models pull {entry.name}"
        told = f"{entry.name} is not here: an unclear order is read by one model only ({pull})"
        return Check(SECOND_READER, "ok", told)
    return replace(check_files(entry), name=SECOND_READER)


def check_memory(weights_mb: int, memory: Path = MEMORY) -> Check:
    """Look whether the memory that is free holds models of `weights_mb`, and at the cores."""
    cores, needed = physical_cores(), weights_mb + WORK_MB
    said = count(cores, "core")
    try:
        lines = dict(line.split(":", 1) for line in memory.read_text(encoding="ascii").splitlines())
        free_mb = int(lines["MemAvailable"].split()[0]) * 1024 // 10**6
    except (OSError, KeyError, ValueError):
        return Check("memory, cores", "ok", f"{said}; how much memory is free cannot be told here")
    found = f"{free_mb} MB free, {needed} MB needed, {said}"
    if free_mb < needed:
        remedy = "close other programs, or choose a smaller model: pa-console models list"
        return Check("memory, cores", "warning", found, remedy)
    if cores < 2:
        return Check("memory, cores", "warning", found, "expect long answers: two cores help")
    return Check("memory, cores", "ok", found)


def check_load(
    idle: Callable[[], float | None] = idle_seconds, wait: Callable[[float], None] = sleep
) -> Check:
    """Look for LOOK_S seconds how many cores other programs leave."""
    began, before = perf_counter(), idle()
    wait(LOOK_S)
    after, seconds = idle(), perf_counter() - began
    cores = physical_cores()
    if before is None or after is None:
        return Check("load", "ok", "how busy the cores are cannot be told here")
    busy = max(0.0, cores - (after - before) / seconds)
    found = f"{busy:.1f} of {count(cores, 'core')} busy"
    if busy <= cores * QUIET_SHARE:
        return Check("load", "ok", found)
    remedy = "answers take longer beside other work: close other programs"
    return Check("load", "warning", found, remedy)


def check_folders(loaded: LoadedSettings) -> Iterator[Check]:
    """Look whether config, logs, cache and keys can be written, by their owner alone; at room."""
    logs, change = loaded.values.logs or default_folder(), "pa-console settings set"
    for name, folder, field, rights in (
        ("config folder", loaded.path.parent, "PA_CONSOLE_SETTINGS", 0o022),
        ("log folder", logs, f"{change} logs", 0o077),
        ("cache folder", cache_folder(), f"{change} cache", 0),
        ("signing key", key_path().parent, f"{change} signing_key", 0o022),
        ("site keys", site_keys(), f"{change} signing_key", 0o022),
    ):
        if name == "site keys" and not folder.exists():
            continue
        found = check_folder(name, folder, field)
        if rights and found.state == "ok" and (exposure := exposed(folder, rights)) is not None:
            found = Check(name, "warning", *exposure)
        yield found


def check_sessions(folder: Path) -> Check:
    """Check that every session of the index in `folder` is there, whole, and its own."""
    name, remedy = "session logs", "bring them back from a copy; --verify of a log tells more"
    try:
        found = check_index(folder, known_keys())
    except (LogError, SigningError) as error:
        return Check(name, "warning", str(error), "look at that file")
    if found.all_problems:
        return Check(name, "warning", "; ".join(found.all_problems), remedy)
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


def check_broker(folder: Path) -> Check:
    """Look whether the configuration of a site's broker ties client ids to certificates."""
    file = folder / CONFIGURATION
    try:
        lacks = unbound(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError):
        found = f"no {CONFIGURATION} in {folder}: look on the machine of the broker"
        return Check("broker", "warning", found)
    if not lacks:
        return Check("broker", "ok", f"{file}: client ids are the names in certificates")
    found = (
        f"{file} lacks '{', '.join(lacks)}': any robot can connect with the client id of another "
        "one, which then misses its stops"
    )
    remedy = (
        f"pa-console site init {folder}, with the --site, --port and --world that it was made "
        "with (certificates stay), then start the broker again"
    )
    return Check("broker", "missing", found, remedy)


def check_schemes() -> Iterator[Check]:
    """Look for the kinds of robots that `--fleet` takes; a missing extra is no fault."""
    yield Check("link mqtt, mqtts", "ok", "robots on a message bus (VDA 5050)")
    for scheme, point in link_schemes().items():
        try:
            point.load()
        except ModuleNotFoundError as error:
            found = f"not installed ({error.name} is missing)"
            if point in OWN:
                found += f"; {install_hint(scheme)} adds it"
            yield Check(f"link {scheme}", "ok" if point in OWN else "warning", found)
        except Exception as error:  # whatever a package of somebody else raises when it is loaded
            found = f"{point.value} cannot be loaded: {type(error).__name__}: {error}"
            yield Check(f"link {scheme}", "warning", found, "ask who made it, or uninstall it")
        else:
            yield Check(f"link {scheme}", "ok", point.value)


def check_link(url: str, settings: Settings) -> Check:
    """Look at the robots on the link at `url`, beside the world that the settings name."""
    name = f"link {url}"
    try:
        world, _ = open_world(settings.world)
        seen = survey(url, world, settings, examine=True)
    except (ValueError, DocumentError) as error:
        return Check(name, "missing", str(error), "see 'pa-console manual connect-a-robot'")
    if seen.problem:
        return Check(name, "missing", seen.in_words(), "see its address and the network")
    remedy = "switch on what is silent; see its names" if seen.silent or not seen.agents else ""
    if any(finding.consequence for finding in seen.findings):
        remedy = remedy or "see the table: set the parameters as it says, and start the robot again"
    state: State = "warning" if remedy else "ok"
    return Check(name, state, seen.in_words(), remedy, seen.findings)


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
    """Report the terminal's colours; none are wanted when `plain`."""
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
