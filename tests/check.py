"""`python -m tests.check`: types and tests of what changed, and the safety invariants.

Run by `make check`. Changed is what differs from where the branch left the main one, committed or
not. Types are checked in the changed modules and those that import them. The tests of a changed
module are the files nearest to it in the import graph; of a file that no test imports, those of
its package whose text names it; of many, those of the most changed modules. Invariants run first
and always; a test that has not begun when the time is up is skipped.
"""

import argparse
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import cast

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"pa_console": Path(), "tests": Path(), "pa_training": Path("models/training")}
"""The packages whose imports are followed, and the folder that holds each."""
MAIN = ("origin/main", "main")
MOST_FILES = 24
"""The most files of tests, those nearest to the most changed modules, besides the invariants."""
TIME_S = 60.0
"""So long after the tests began, one that is no invariant does not begin any more."""


def changed_files(base: str) -> list[Path]:
    """Return what differs from the commit `base`, and what git does not know yet."""
    tracked = _git("diff", "--name-only", "--diff-filter=d", base)
    return sorted({Path(line) for line in tracked + _git("ls-files", "-o", "--exclude-standard")})


def branch_base() -> str:
    """Return the commit where this branch left the main one, or the last one where none is."""
    for name in MAIN:
        if found := _git("merge-base", "HEAD", name, missing=[]):
            return found[0]
    return "HEAD"


def _git(*words: str, missing: list[str] | None = None) -> list[str]:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode and missing is None:
        sys.exit(f"git {words[0]}: {done.stderr.strip()}")
    return done.stdout.splitlines() if not done.returncode else missing or []


class Imports:
    """Modules of the project, and what imports them."""

    def __init__(self) -> None:
        sys.path[:0] = [str(ROOT / folder) for folder in {*PACKAGES.values()}]
        self._graph = grimp.build_graph(*PACKAGES, cache_dir=None)

    def module(self, path: Path) -> str | None:
        """Return the name of the module in `path`, None if it is not one of the project."""
        for package, folder in PACKAGES.items():
            if path.suffix == ".py" and path.is_relative_to(folder / package):
                name = ".".join(path.relative_to(folder).with_suffix("").parts)
                name = name.removesuffix(".__init__")
                return name if name in self._graph.modules else None
        return None

    def path(self, module: str) -> Path:
        """Return the file of a module, relative to the checkout."""
        place = PACKAGES[module.partition(".")[0]] / Path(*module.split("."))
        package = place / "__init__.py"
        return package if (ROOT / package).exists() else place.with_suffix(".py")

    def direct(self, module: str) -> set[str]:
        """Return the modules that import `module` themselves."""
        return self._graph.find_modules_that_directly_import(module)

    def nearest_tests(self, path: Path) -> list[Path]:
        """Return the files of tests that are nearest to a changed file."""
        module = self.module(path)
        seen = {module} if module else set[str]()
        ring = set(seen)
        while ring:
            if tests := [each for each in map(self.path, ring) if _is_test(each)]:
                return sorted(tests)
            ring = {user for each in ring for user in self.direct(each)} - seen
            seen |= ring
        return tests_that_name(path)


def tests_that_name(path: Path) -> list[Path]:
    """Return the tests, of the file's own package if it has some, whose text has its name.

    A picture or a table that belongs to one file of tests lies in a folder of its name.
    """
    if (owner := next((part for part in path.parts[:-1] if part.startswith("test_")), None)) and (
        owners := [each for each in _tests(ROOT / "tests") if each.stem == owner]
    ):
        return owners
    name = path.stem if path.suffix == ".py" else path.name
    own = ROOT / "tests" / path.parts[1] if len(path.parts) > 1 else ROOT
    files = _tests(own if own.is_dir() else ROOT / "tests")
    return [each for each in files if name in (ROOT / each).read_text(encoding="utf-8")]


def invariant_tests() -> list[Path]:
    """Return the files that hold safety invariants."""
    mark = "pytest.mark.invariant"
    files = _tests(ROOT / "tests")
    return [each for each in files if mark in (ROOT / each).read_text(encoding="utf-8")]


def _tests(folder: Path) -> list[Path]:
    return sorted(each.relative_to(ROOT) for each in folder.rglob("test_*.py"))


def _is_test(path: Path) -> bool:
    return path.name.startswith("test_")


def typed(changed: Iterable[Path], imports: Imports) -> list[str]:
    """Return the changed modules and those that import them, without what pyright leaves out."""
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    left_out: list[str] = config["tool"]["pyright"]["exclude"]
    modules = {name for path in changed if (name := imports.module(path))}
    users = {user for name in modules for user in imports.direct(name)}
    paths = sorted({imports.path(name) for name in modules | users})
    return [str(path) for path in paths if not any(map(path.is_relative_to, left_out))]


def main(arguments: list[str]) -> int:
    """Check types and run tests; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.check", description=__doc__)
    parser.add_argument("--since", help="the commit to compare with; default: where main was left")
    options, passed_on = parser.parse_known_args(arguments)
    changed = changed_files(options.since or branch_base())
    imports = Imports()
    files = typed(changed, imports)
    print(f"{len(changed)} files changed; types of {len(files)} modules", flush=True)
    if files and _run("pyright", "--pythonpath", sys.executable, *files):
        return 1
    found = Counter(test for path in changed for test in imports.nearest_tests(path))
    found.update({path: len(changed) for path in changed if _is_test(path) and path in found})
    nearest = [path for path, _ in found.most_common(MOST_FILES)]
    invariants, left_out = invariant_tests(), len(found) - len(nearest)
    print(f"tests: {len(invariants)} files of invariants, {len(nearest)} nearest to the change")
    if left_out:
        print(f"{left_out} more files are as near to a changed module: `make test` runs them")
    sys.stdout.flush()
    wanted = map(str, dict.fromkeys([*invariants, *nearest]))
    near = [f"--nearest={path}" for path in nearest]
    return _run("pytest", "-q", "-p", "tests.check", *near, *passed_on, *wanted)


def _run(program: str, *words: str) -> int:
    return subprocess.run([sys.executable, "-m", program, *words], cwd=ROOT, check=False).returncode


# The rest is a plugin of pytest: it orders and limits what `main` has chosen.

_BEGAN = time.monotonic()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Take the files whose tests are all wanted; of other files only invariants are."""
    parser.addoption("--nearest", action="append", default=[], help="file of tests to run whole")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the invariants, and leave out what else their files hold."""
    near = {ROOT / path for path in cast(list[str], config.getoption("--nearest"))}
    wanted = [item for item in items if _is_invariant(item) or item.path in near]
    if dropped := [item for item in items if item not in wanted]:
        config.hook.pytest_deselected(items=dropped)
    items[:] = sorted(wanted, key=lambda item: not _is_invariant(item))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what comes too late to be over in time."""
    if not _is_invariant(item) and time.monotonic() - _BEGAN > TIME_S:
        pytest.skip(f"{TIME_S:.0f} s are over: `make test` runs it")


def _is_invariant(item: pytest.Item) -> bool:
    return item.get_closest_marker("invariant") is not None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
