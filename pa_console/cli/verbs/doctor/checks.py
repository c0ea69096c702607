"""The checks of this machine: Python, libraries, settings, folders, links to robots, terminal."""

import importlib
import logging
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from pathlib import Path
from typing import Literal

from rich.console import Console

from pa_console.child_processes import python_command
from pa_console.cli.sessions.fleet import open_listener
from pa_console.fleets.link import OWN, LinkFinding, link_schemes
from pa_console.fleets.newcomers import survey
from pa_console.fleets.vda5050.site_files import CONFIGURATION, unbound
from pa_console.llm.models.cache import cache_folder
from pa_console.private_files import exposed, nearest_existing, unwritable
from pa_console.resources import install_hint, missing_library
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
LEAST_FREE_MB = 200
"""The free space, in megabytes, below which there is a warning about a folder."""
COMFORTABLE, LEAST = (80, 24), (60, 18)
"""The smallest terminal (columns, lines) for comfortable use, and for any use at all."""


@dataclass(frozen=True)
class Check:
    """The result of one check; `remedy` is empty if there is no problem."""

    name: str
    state: State
    found: str
    remedy: str = ""
    details: tuple[LinkFinding, ...] = ()
    """The findings about the robots of a link."""

    @classmethod
    def graded(
        cls, name: str, good: bool, found: str, remedy: str, bad: State = "warning"
    ) -> "Check":
        """Return a check in the state ok if it is `good`, else in the state `bad` with a remedy."""
        return cls(name, "ok", found) if good else cls(name, bad, found, remedy)


def check_python() -> Check:
    """Check the version of Python."""
    result, good = f"{sys.version.split()[0]} in {sys.prefix}", sys.version_info >= (3, 11)
    return Check.graded("Python", good, result, "install Python 3.11 or newer", "missing")


def check_build_tools() -> Iterator[Check]:
    """Check the tools that compile llama.cpp, which are needed only until it is compiled."""
    built = _problem_of("llama_cpp") == ""
    compilers = (os.environ.get("CXX", ""), "c++", "g++", "clang++")
    for name, commands, package in (
        ("C++ compiler", compilers, "g++"),
        ("CMake", ("cmake",), "cmake"),
    ):
        path = next((path for item in commands if item and (path := shutil.which(item))), "")
        need = "not needed, llama.cpp is built" if built else "needed to build llama.cpp"
        result = path or f"not found; {need}"
        remedy = f"install it, e.g. on Debian and Ubuntu: apt install {package}"
        yield Check.graded(name, bool(path) or built, result, remedy, "missing")


def check_libraries() -> Iterator[Check]:
    """Check that every required library can be imported; extras are not checked."""
    try:
        requirements = requires(PACKAGE) or []
    except PackageNotFoundError:
        remedy = "install it: pip install ."
        yield Check("libraries", "missing", f"{PACKAGE} is not installed", remedy)
        return
    modules: dict[str, list[str]] = {}
    for module, names in packages_distributions().items():
        for name in names:
            modules.setdefault(_canonical(name), []).append(module)
    for line in requirements:
        if "extra ==" in line:
            continue
        name = re.split(r"[^\w.-]", line)[0]
        yield _check_library(name, line, modules.get(_canonical(name), []))


def _check_library(name: str, requirement: str, modules: list[str]) -> Check:
    command = python_command("-m", "pip", "install", "--force-reinstall", requirement)
    remedy = f"reinstall it: {shlex.join(command)}"
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
    """Return why `module` cannot be imported; '' if it can."""
    logging.getLogger(module).setLevel(logging.ERROR)  # no warnings, e.g. about folders
    try:
        importlib.import_module(module)
    except Exception as error:  # a broken library may raise any error
        return f"{type(error).__name__}: {error}"
    return ""


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def load_or_default() -> tuple[LoadedSettings, Check]:
    """Return the settings, or the defaults if they are not valid, and the check of the settings."""
    from pa_console.tui.screens.settings import problems  # noqa: PLC0415 - the screen's libraries

    remedy = "correct it, or restore the defaults: pa-console settings reset"
    try:
        loaded = load_settings()
    except DocumentError as error:
        return default_settings(), Check("settings", "missing", str(error), remedy)
    if wrong := [str(loaded.error(field, why)) for field, why in problems(loaded.values)]:
        return loaded, Check("settings", "missing", "; ".join(wrong), remedy)
    if unknown := unknown_variables():
        problem = f"unknown variables: {', '.join(unknown)}"
        return loaded, Check("settings", "warning", problem, "see 'pa-console settings show'")
    note = "" if loaded.document is not None else " does not exist; the defaults apply"
    return loaded, Check("settings", "ok", f"{loaded.path}{note}")


def check_folders(loaded: LoadedSettings) -> Iterator[Check]:
    """Check the folders of config, logs, cache and keys: access, private rights and free space."""
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
        check = check_folder(name, folder, field)
        if rights and check.state == "ok" and (exposure := exposed(folder, rights)) is not None:
            check = Check(name, "warning", *exposure)
        yield check


def check_sessions(folder: Path) -> Check:
    """Check that the log of every session in the index in `folder` is complete and unchanged."""
    name = "session logs"
    remedy = "restore them from a backup; for details: pa-console replay LOG --verify"
    try:
        index = check_index(folder, known_keys())
    except (LogError, SigningError) as error:
        return Check(name, "warning", str(error), "check that file")
    whole = f"{count(len(index.sessions), 'session')} in the index, none missing"
    problems = "; ".join(index.all_problems)
    return Check.graded(name, not problems, problems or whole, remedy)


def check_folder(name: str, folder: Path, field: str) -> Check:
    """Check that a folder is writable and has free space; `field` names how to choose another."""
    remedy = f"make it writable, or choose another folder: {field}"
    if why := unwritable(folder):
        return Check(name, "missing", f"{folder}: {why}", remedy)
    free_mb = shutil.disk_usage(nearest_existing(folder)).free // 1_000_000
    result = f"{folder}, {free_mb} MB free"
    remedy = f"free some space, or choose another folder: {field}"
    bad: State = "warning" if free_mb else "missing"
    return Check.graded(name, free_mb >= LEAST_FREE_MB, result, remedy, bad)


def check_broker(folder: Path) -> Check:
    """Check that the configuration of a site's broker ties client ids to certificates."""
    file = folder / CONFIGURATION
    try:
        lacks = unbound(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError):
        result = f"no {CONFIGURATION} in {folder}: run this check on the machine of the broker"
        return Check("broker", "warning", result)
    if not lacks:
        return Check("broker", "ok", f"{file}: client ids are tied to certificates")
    result = (
        f"{file} lacks '{', '.join(lacks)}': a robot could connect with the client id of another "
        "robot, which would then miss its stops"
    )
    remedy = (
        f"run 'pa-console site init {folder}' with the same --site, --port and --world as before "
        "(certificates are kept), then restart the broker"
    )
    return Check("broker", "missing", result, remedy)


def check_schemes() -> Iterator[Check]:
    """Check the kinds of links for `--fleet`; a missing extra is not a problem."""
    bus = missing_library("aiomqtt", "vda5050", "robots on a message bus (VDA 5050) need")
    yield Check("link mqtt, mqtts", "ok", bus or "robots on a message bus (VDA 5050)")
    for scheme, point in link_schemes().items():
        try:
            point.load()
        except ModuleNotFoundError as error:
            result = f"not installed ({error.name} is missing)"
            if point in OWN:
                result += f"; to add it: {install_hint(scheme)}"
            yield Check(f"link {scheme}", "ok" if point in OWN else "warning", result)
        except Exception as error:  # another author's package may raise any error
            result = f"{point.value} cannot be loaded: {type(error).__name__}: {error}"
            yield Check(f"link {scheme}", "warning", result, "contact its author, or uninstall it")
        else:
            yield Check(f"link {scheme}", "ok", point.value)


def check_link(url: str, settings: Settings, certificates: Path | None = None) -> Check:
    """Check the robots on the link at `url` against the world in the settings."""
    name = f"link {url}"
    try:
        world, _ = open_world(settings.world)
        seen = survey(open_listener(url, certificates, world, settings), examine=True)
    except (ValueError, DocumentError) as error:
        return Check(name, "missing", str(error), "see 'pa-console manual connect-a-robot'")
    if seen.problem:
        return Check(name, "missing", seen.in_words(), "check its address and the network")
    lacking = seen.silent or not seen.agents
    remedy = "switch on the silent robots, and check their names" if lacking else ""
    if any(finding.consequence for finding in seen.findings):
        remedy = remedy or "set up the robot as the table shows, and restart it"
    state: State = "warning" if remedy else "ok"
    return Check(name, state, seen.in_words(), remedy, seen.findings)


def check_terminal() -> Iterator[Check]:
    """Check the terminal: its size, its colours and its characters."""
    if not sys.stdout.isatty():
        remedy = "run doctor in the terminal where you use the console"
        yield Check("terminal", "warning", "output is not a terminal", remedy)
        return
    size = shutil.get_terminal_size()
    yield check_size(size.columns, size.lines)
    yield check_colours(Console().color_system, bool(os.environ.get("NO_COLOR")))
    yield check_unicode(sys.stdout.encoding)


def check_size(columns: int, lines: int) -> Check:
    """Check that the console fits on the terminal."""
    good = columns >= COMFORTABLE[0] and lines >= COMFORTABLE[1]
    bad: State = "missing" if columns < LEAST[0] or lines < LEAST[1] else "warning"
    remedy = "use at least 80 x 24, or 100 x 30 for all panes"
    return Check.graded("terminal size", good, f"{columns} x {lines}", remedy, bad)


def check_colours(system: str | None, plain: bool) -> Check:
    """Check the terminal's colours; if `plain` is True, none are wanted."""
    if plain:
        return Check("colours", "ok", "none, because NO_COLOR is set")
    remedy = "export TERM=xterm-256color, and COLORTERM=truecolor if the terminal supports it"
    return Check.graded("colours", system in ("256", "truecolor"), system or "none", remedy)


def check_unicode(encoding: str) -> Check:
    """Check that the terminal can show characters such as ▲."""
    good = encoding.lower().replace("-", "") == "utf8"
    return Check.graded("Unicode", good, encoding, "export LANG=C.UTF-8", "missing")
