"""Whether Python, the build tools and the libraries are here, and how to mend what is not."""

import importlib
import os
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from typing import Literal

State = Literal["ok", "warning", "missing"]
PACKAGE = "pa-console"


@dataclass(frozen=True)
class Check:
    """One thing that was looked at; `remedy` is empty when all is well."""

    name: str
    state: State
    found: str
    remedy: str = ""


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
    remedy = f"install it again: {sys.executable} -m pip install --force-reinstall '{asked}'"
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
    try:
        importlib.import_module(module)
    except Exception as error:  # whatever a broken library raises when it is loaded
        return f"{type(error).__name__}: {error}"
    return ""


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
