"""Rule files that are made to crash, freeze or fill the console: nine kinds, any number of each."""

import json
import random
import resource
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rulebook import load_rules
from pa_console.schema.document import DocumentError
from tests.policy.test_large import MISSION, large_plan, large_rehearsal, large_world

Check = Callable[[random.Random], str]


def terms(rng: random.Random) -> str:
    """Return thousands of terms in one chain, which overflowed the stack of the parser."""
    sign, term = rng.choice([("+", "1"), ("-", "1"), ("*", "1"), (" < ", "1"), (".", "plan")])
    chain = sign.join([term] * rng.randrange(1_000, 60_000))
    return f"{chain} == 1"


def nesting(rng: random.Random) -> str:
    """Return brackets, calls or signs inside each other."""
    opening, core, closing = rng.choice(
        [("(", "true", ")"), ("[", "", "]"), ("!(", "true", ")"), ("size([", "1", "])"),
         ("(1 + ", "1", ")"), ("true ? (", "true", ") : false"), ("-(", "1", ")")]
    )  # fmt: skip
    depth = rng.choice((20, 30, 60, 200, 5_000, 20_000))
    return opening * depth + core + closing * depth + rng.choice(("", " == 1"))


def loops(rng: random.Random) -> str:
    """Return loops inside each other over lists that are long already."""
    depth = rng.randrange(2, 8)
    source = rng.choice(("assets", "gates", "world.frames", f"[{', '.join(['1'] * 150)}]"))
    kind = rng.choice(("all", "exists", "map", "filter", "exists_one"))
    inner = {"all": "true", "exists": "false", "map": "1", "filter": "true", "exists_one": "true"}
    wrap = {"all": "{} || true", "exists": "{} && false", "map": "{}", "filter": "size({}) > 0",
            "exists_one": "{}"}  # fmt: skip
    body = inner[kind]
    for level in range(depth):
        loop = f"{source}.{kind}(v{level}, {body})"
        body = wrap[kind].format(loop) if level < depth - 1 else loop
    return f"size({body}) > 0" if kind in ("map", "filter") else body


def growth(rng: random.Random) -> str:
    """Return loops of which each doubles, or more, what the one before has built."""
    text = rng.choice(("mission.text", "plan.reason", "'" + "a" * rng.randrange(10, 3_000) + "'"))
    grown = f"[{text}]"
    for level in range(rng.randrange(3, 16)):
        copies = rng.randrange(2, 12)
        step = rng.choice((" + ".join([f"v{level}"] * copies), None))
        nested = f"[{', '.join([f'v{level}'] * copies)}]"
        grown = f"{grown}.map(v{level}, {step or nested})"
    return f"size({grown}) > 0"


def chained(rng: random.Random) -> str:
    """Return a text that every cut makes longer."""
    pattern = rng.choice(("''", "'x*'", r"r'\b'"))
    cuts = f".without({pattern})" * rng.randrange(5, 60)
    return f"size((mission.text + plan.reason){cuts}) >= 0"


def backtracking(rng: random.Random) -> str:
    """Return a pattern on which an engine that backtracks goes on for hours."""
    unit = rng.choice((r"\w+\s?", r"a+", r"(?:a|a)", r"[\w ]+", r"(?:\w|\d)+", r".*", r"(?:a|aa)"))
    end = rng.choice(("$", "!", "[0-9]{3}", "x{3}y"))
    look = rng.choice(("", "", r"(?=.)", r"(?!zz)"))
    text = rng.choice(("mission.text", "plan.reason", f"'{'a' * rng.randrange(20, 2_000)}é'"))
    return f'!{text}.{rng.choice(("finds", "matches"))}(r"{look}^({unit})+{end}")'


def repetition(rng: random.Random) -> str:
    """Return a pattern that is small to write and huge to compile."""
    many = rng.randrange(10, 999)
    pattern = rng.choice(
        (
            rf"(\w{{{many}}}){{{many}}}",
            rf"((a{{0,{many}}}){{0,{many}}}){{0,{many}}}",
            rf"(?:x|y){{{many},}}(?:\w{{1,{many}}}z){{1,{rng.randrange(2, 9)}}}",
            "(" * many + ")" * many,
            "|".join(f"(?:word{number}\\w*)" for number in range(many * 4)),
            rf"(a)(b)\{rng.randrange(1, 3)}",
        )
    )
    return f'!mission.text.finds(r"{pattern}")'


def crowds(rng: random.Random) -> str:
    """Return a check that takes nearly all the time that it may; a file may hold hundreds."""
    return f"assets.all(a, gates.all(g, assets.all(b, a.id != 'x{rng.randrange(9)}' || g == b)))"


def moments(rng: random.Random) -> str:
    """Return loops over a list that is written out, for orderings, which run at every telemetry."""
    ones = f"[{', '.join(['1'] * rng.randrange(20, 60))}]"
    return f"{ones}.all(a, {ones}.all(b, {ones}.all(c, a + b + c + {rng.randrange(9)} > 0)))"


KINDS: dict[str, tuple[Check, int]] = {
    "terms": (terms, 1),
    "nesting": (nesting, 1),
    "loops": (loops, 3),
    "growth": (growth, 3),
    "chained": (chained, 3),
    "backtracking": (backtracking, 5),
    "repetition": (repetition, 5),
    "crowds": (crowds, 400),
    "moments": (moments, 100),
}
"""What makes an expression of each kind, and how many of them a file has."""


def write_hostile(folder: Path, kind: str, seed: int) -> Path:
    """Write the rule file of that kind and number; its checks, or orderings, are critical."""
    rng = random.Random(f"{kind} {seed}")
    make, most = KINDS[kind]
    rules: list[dict[str, Any]] = []
    for number in range(most if most > 5 else rng.randrange(1, most + 1)):
        rule = {"id": f"ROE-{number + 100}", "domain": "ROE", "priority": "critical", "text": "t"}
        decides: dict[str, Any] = {"check": make(rng), "message": "hostile"}
        if kind == "moments":
            event = decides["check"]
            decides = {
                "order": [{"kind": "until", "event": event, "other": "false", "message": "m"}]
            }
        rules.append(rule | decides)
    path = folder / f"{kind}-{seed}.yaml"
    path.write_text(json.dumps({"name": "hostile", "version": "1", "rules": rules}))
    return path


def measure(path: Path) -> dict[str, Any]:
    """Load the file at `path` and decide a plan at a checkpoint by it; return what that took."""
    world = large_world(60, 8)
    plan = large_plan(world)
    rehearsal = large_rehearsal(world, plan, tracks=10, moments=5)
    mission = MISSION.model_copy(update={"text": ("a" * 40 + " ") * 45 + "!"})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started, used = perf_counter(), process_time()
    try:
        book = load_rules(path)
    except DocumentError as error:
        loaded, findings, problem = process_time() - used, (), str(error)
    else:
        loaded, problem = process_time() - used, ""
        findings = check_plan(
            book, plan=plan, rehearsal=rehearsal, mission=mission, world=world
        ) + check_mission(book, mission, world)
    decided, wall = process_time() - used - loaded, perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "problem": problem,
        "load_s": loaded,
        "decide_s": decided,
        "wall_s": wall,
        "grown_mb": (after - before) / 1024,
        "errors": sum(found.status == "error" for found in findings),
        "blocking": sum(found.blocking for found in findings),
        "findings": len(findings),
    }


def measure_apart(path: Path) -> dict[str, Any]:
    """Return the same, found by a process of its own; `exit` is not 0 where that one died."""
    context = get_context("fork")
    found, told = context.Pipe(duplex=False)
    process = context.Process(target=_measure_into, args=(told, path))
    process.start()
    told.close()
    try:
        values: dict[str, Any] = found.recv()
    except EOFError:
        values = {}
    process.join()
    return {"exit": process.exitcode, **values}


def _measure_into(told: Connection, path: Path) -> None:
    told.send(measure(path))
