"""Kills the process at a chosen line: a call before each statement of the modules under test.

The modules are compiled anew when they are imported, so `instrument` comes before their import.
A counted line costs 0.2 µs; a tracer of the interpreter would slow down every other module too.
"""

import ast
import os
import signal
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import NamedTuple

MODULES = (
    "pa_console.private_files",
    "pa_console.signing",
    "pa_console.session.log.chain",
    "pa_console.session.log.writer",
    "pa_console.session.log.session_index",
    "pa_console.session.log.signed_head",
    "pa_console.mission.gate",
    "pa_console.mission.execute",
    "pa_console.mission.decide",
    "pa_console.mission.stop",
    "pa_console.fleets.key_folder",
)
"""The modules between an event and a command, and those that write keys."""

CALLED = "_line_is_reached_"
STATEMENTS = ("body", "orelse", "finalbody")


class Line(NamedTuple):
    """A line of a module under test."""

    module: str
    number: int


class _Reached:
    """The lines that were reached, and the one to die at, at its time number `left`."""

    def __init__(self) -> None:
        self.counts: Counter[Line] = Counter()
        self.target: Line | None = None
        self.left = 0

    def line(self, module: str, number: int) -> None:
        """Count the line; end the process there if its time has come."""
        line = Line(module, number)
        self.counts[line] += 1
        if line == self.target:
            self.left -= 1
            if self.left == 0:
                os.kill(os.getpid(), signal.SIGKILL)


REACHED = _Reached()


def die_at(line: Line | None, times: int = 1) -> None:
    """Count anew; end this process when `line` is reached for the time number `times`."""
    REACHED.counts.clear()
    REACHED.target, REACHED.left = line, times


class _Marked(ast.NodeTransformer):
    """Puts a call before each statement of each function."""

    def __init__(self) -> None:
        self._depth = 0

    def visit(self, node: ast.AST) -> ast.AST:
        """Mark the statements in `node`."""
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        self._depth += inside
        self.generic_visit(node)
        if self._depth:
            for field in STATEMENTS:
                # A lambda and a conditional expression have a `body` that is no list.
                block: list[ast.stmt] | ast.expr | None = getattr(node, field, None)
                if isinstance(block, list):
                    setattr(node, field, _with_calls(block))
        self._depth -= inside
        return node


def _with_calls(block: Sequence[ast.stmt]) -> list[ast.stmt]:
    marked: list[ast.stmt] = []
    for statement in block:
        number = ast.Constant(statement.lineno)
        call = ast.Call(ast.Name(CALLED, ast.Load()), [number], [])
        marked += [ast.copy_location(ast.Expr(call), statement), statement]
    return marked


class _Loader(SourceFileLoader):
    """Compiles a module with a call before each of its statements; nothing is cached."""

    def exec_module(self, module: ModuleType) -> None:
        """Run the module's code."""
        tree = _Marked().visit(ast.parse(self.get_data(self.path)))
        code = compile(ast.fix_missing_locations(tree), self.path, "exec")  # pyright: ignore[reportArgumentType, reportCallIssue]
        vars(module)[CALLED] = partial(REACHED.line, module.__name__)
        exec(code, vars(module))


class _Finder(MetaPathFinder):
    def __init__(self, modules: Sequence[str]) -> None:
        self._modules = frozenset(modules)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how a module under test is loaded, None for any other."""
        if fullname not in self._modules:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.origin is None:
            return None
        spec.loader = _Loader(fullname, spec.origin)
        return spec


def instrument(modules: Sequence[str] = MODULES) -> None:
    """Count the lines of `modules`, which must not be imported yet."""
    early = [name for name in modules if name in sys.modules]
    if early:
        raise ValueError(f"imported too early: {', '.join(early)}")
    sys.meta_path.insert(0, _Finder(modules))
