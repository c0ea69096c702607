"""No rule file ends, freezes or fills the console: it is refused, or its checks end in time."""

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cel
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.mission import examine as safeguards
from pa_console.policy import rule_checks
from pa_console.policy.expressions.deadlines import (
    DeadlineError,
    deadline,
    going_on,
    shared_deadline,
)
from pa_console.policy.expressions.expression import (
    PLAN_VARIABLES,
    Expression,
    compiled_pattern,
    make_context,
)
from pa_console.policy.expressions.syntax import MAX_TOKENS, Source
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import Compiler, Rulebook, load_rules
from pa_console.schema.document import DocumentError
from pa_console.schema.plan import Plan
from pa_console.schema.rule import Rule
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site
from tests.attacks.hostile_rules import KINDS, measure, measure_apart, write_hostile
from tests.policy.book import write_rules
from tests.policy.test_large import MISSION

pytestmark = pytest.mark.long

ENDLESS = "l.exists(a, l.exists(b, l.exists(c, l.exists(d, a + b + c + d < 0))))"
LONG: dict[str, Any] = {"gates": list(range(400))}
CHECKS_S = rule_checks.CHECKS_S
"""The console's own time; other tests are given more of it."""


@pytest.fixture(scope="module", autouse=True)
def _no_more_time_than_the_console_gives() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rule_checks, "CHECKS_S", CHECKS_S)
        yield


def test_twenty_thousand_terms_end_no_process(tmp_path: Path) -> None:
    chain = "+".join(["1"] * 20_000)
    check = {"check": f"{chain} > 0", "message": "x"}
    found = measure_apart(write_rules(tmp_path, check))
    assert found["exit"] == 0
    assert "rules.0.check: too long" in found["problem"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_hostile_file_is_refused_or_decided(tmp_path: Path, kind: str) -> None:
    for seed in range(2):
        found = measure(write_hostile(tmp_path, kind, seed))
        if found["problem"]:
            assert f"{kind}-{seed}.yaml:" in found["problem"]
            assert "check: " in found["problem"]
        else:
            assert found["findings"]
            assert found["blocking"] >= found["errors"]


@pytest.mark.parametrize(
    ("check", "problem"),
    [
        ("+".join(["1"] * (MAX_TOKENS // 2 + 1)) + " > 0", "more than 800 names"),
        ("true" + " " * 40_000, "too long"),
        ("(" * 25 + "true" + ")" * 25, "nested deeper than 24"),
        ("g.all(a, g.all(b, g.all(c, g.all(d, g.all(e, true)))))".replace("g.", "gates."),
         "loops are nested deeper than 4"),
        ("[mission.text].map(a, a+a+a+a).map(b, b+b+b+b).map(c, c+c+c+c).map(d, d+d+d+d+d)"
         ".map(e, e + e + e) == []", "could grow"),
        ('mission.text.finds("(a)\\\\1")', "backreferences"),
        ('mission.text.finds("(?>a+)b")', "not supported"),
        ('mission.text.finds("(")', "not a regular expression"),
        ("mission.text.finds(mission.words)", "must be written out"),
        ("actions.all((a), true)", "a plain name"),
        ("__going_on()", "a rule may not use"),
    ],
)  # fmt: skip
def test_what_is_too_large_or_not_supported_is_named_with_its_place(
    tmp_path: Path, check: str, problem: str
) -> None:
    path = write_rules(tmp_path, {"check": check, "message": "x"})
    with pytest.raises(DocumentError, match=problem) as caught:
        load_rules(path)
    assert "rules.0.check" in str(caught.value)


def test_a_file_of_too_many_expressions_is_refused(tmp_path: Path) -> None:
    rules = [
        {"id": f"ROE-{n:05}", "check": "size(actions) > 0", "message": "x"} for n in range(4000)
    ]
    with pytest.raises(DocumentError, match=r"too many for one file|more than 30,000 values"):
        load_rules(write_rules(tmp_path, *rules))


@pytest.mark.parametrize(
    "source",
    [
        ENDLESS,
        f"{ENDLESS} || true",
        ENDLESS.replace("exists", "all").replace("< 0", ">= 0"),
        "size(l.map(a, l.map(b, l.map(c, l.map(d, a))))) > 0",
        "size(l.filter(a, size(l.filter(b, size(l.filter(c, true)) > 0)) > 0)) > 0",
        "l.all(a, l.all(b, l.all(c, l.all(d, true) || true) || true) || true)",
        "l.all(a, l.exists(b, l.exists(c, l.exists(d, false) && false) && false) || true)",
    ],
)
def test_a_loop_without_end_is_an_error_whatever_is_made_of_it(source: str) -> None:
    expression = Expression(source.replace("l.", "gates."))
    with pytest.raises(DeadlineError, match="longer than the 10 ms"):
        expression.evaluate(make_context(LONG))


def test_a_loop_that_is_out_of_time_goes_no_round_further() -> None:
    rounds = 0

    def last() -> bool:
        nonlocal rounds
        rounds += 1
        return False

    watched = cel.compile(Source("l.map(a, l.map(b, l.map(c, 1)))").watched())
    functions: dict[str, Any] = {"__going_on": last}
    watched.execute(cel.Context(variables={"l": list(range(50))}, functions=functions))
    assert rounds == 50


def test_a_pattern_that_takes_hours_elsewhere_has_an_answer_here() -> None:
    text = "a" * 2_000 + "!"
    assert compiled_pattern(r"^(\w+\s?)+$").search(text) is False
    assert compiled_pattern(r"^(\w+\s?)+$").cut("ab cd", "-") == "-"


def test_a_pattern_that_looks_ahead_is_broken_off_when_time_is_up(
    capfd: pytest.CaptureFixture[str],
) -> None:
    slow = Expression(r"""!mission.finds(r"(?=.)^(?:(?:a|aa)+)+!")""")
    with pytest.raises(DeadlineError, match="longer than"):
        slow.evaluate(make_context({"mission": "a" * 200 + "é"}))
    assert capfd.readouterr() == ("", "")


def test_many_slow_checks_have_a_time_together() -> None:
    expression = Expression(ENDLESS.replace("l.", "gates."))
    context = make_context(LONG)
    with shared_deadline(0.015):
        for problem in ("longer than", "longer than", "no time is left"):
            with pytest.raises(DeadlineError, match=problem):
                expression.evaluate(context)


def test_time_is_up_once_for_one_expression_only() -> None:
    rounds = 0
    with pytest.raises(DeadlineError), deadline(0.0):  # noqa: PT012 - it must not go on
        while going_on():
            rounds += 1
    assert rounds < 100
    with deadline(10.0):
        assert going_on()


async def test_checks_share_no_thread_with_telemetry_and_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    site = load_site("checkpoint", "checkpoint")
    used: set[int] = set()
    evaluate = Expression.evaluate

    def noted(self: Expression, context: cel.Context) -> Any:
        used.add(threading.get_ident())
        return evaluate(self, context)

    monitor = Monitor(site.rulebook, site.world)
    monkeypatch.setattr(Expression, "evaluate", noted)
    sim = Checkpoint(site.world, 0)
    plan = Plan.model_validate({"reason": "r", "actions": ()})
    found = await safeguards.examine(plan, MISSION, sim, site.rulebook, monitor)
    assert found.findings
    assert used
    assert threading.get_ident() not in used


async def test_the_loop_goes_on_beside_hundreds_of_endless_checks() -> None:
    site = load_site("checkpoint", "checkpoint")
    source = "[1,2,3,4,5,6,7,8,9].all(p, world.frames.all(a, assets.all(b, assets.all(c, true))))"
    rules = [
        Rule(id=f"ROE-{n + 100}", domain="ROE", priority="critical", text="t", check=source,
             message="m")
        for n in range(200)
    ]  # fmt: skip
    compiler = Compiler()
    book = Rulebook("slow", "", tuple(compiler.rule(rule) for rule in rules))
    sim = Checkpoint(site.world, 0)
    plan = Plan.model_validate({"reason": "r", "actions": ()})
    checking = asyncio.create_task(safeguards.examine(plan, MISSION, sim, book))
    turns = 0
    while not checking.done():
        await asyncio.sleep(0)
        turns += 1
    assert turns > 100
    assert len((await checking).findings) == 200


WORDS = st.sampled_from(
    ["actions", ".all(a, ", ".exists(b, ", ".map(c, ", ".filter(d, ", "true", "a", "b", "c", "d",
     " + ", " && ", " || ", "!", "(", ")", "[", "]", "1", "'x'", ", ", " == ", "size(", "r'\\'",
     " ? ", " : ", "gates", ".x", "'''q'''", "// no\n", "{", "}", "mission.text", ".finds('a')"]
)  # fmt: skip


@settings(deadline=None, max_examples=300)
@given(st.lists(WORDS, max_size=30).map("".join))
def test_watching_a_loop_changes_nothing_that_it_says(source: str) -> None:
    values: dict[str, Any] = dict.fromkeys(PLAN_VARIABLES, 0)
    values |= {"actions": [1, 2], "gates": ["x"], "mission": {"text": "abc"}}
    try:
        plain = cel.compile(source)
    except ValueError:
        with pytest.raises(ValueError, match=r"."):
            Expression(source)
        return
    try:
        expression, problem = Expression(source), ""
    except ValueError as error:
        expression, problem = None, str(error)
    assert "not valid CEL" not in problem
    if expression is None:
        return
    context = make_context(values)

    def said(run: Any) -> object:
        try:
            return repr(run(context))
        except Exception as error:  # what is compared is whether there is one, and of which kind
            return type(error).__name__

    assert said(expression.evaluate) == said(plain.execute)
