"""The monitor says of every ordering, moment by moment, what the whole trace says of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import Compiler, Rulebook, load_rules
from pa_console.schema.rehearsal import Moment, TrackMoment
from pa_console.schema.rule import Ordering, Rule
from tests.policy.book import checkpoint_rules, write_rules

Kind = Literal["before", "after", "never_while", "within", "until"]
Sight = tuple[float, bool, bool]
"""Time, event, other."""

LIMIT_S = 5.0
UNKNOWN = TrackMoment(
    gate="WestGate",
    identity="unknown",
    intent="unknown",
    status="approaching",
    observed=False,
    warned=False,
)


def book_of(kind: Kind, each: Literal["track", "gate"] | None, event: str, other: str) -> Rulebook:
    order = Ordering(
        kind=kind,
        event=event,
        other=other,
        each=each,
        seconds=LIMIT_S if kind == "within" else None,
        message="wrong order",
    )
    rule = Rule(id="WF-01", domain="WF", priority="high", text="In order.", order=(order,))
    return Rulebook("own", "", (Compiler(deadline_s=60.0).rule(rule),))


def track(event: bool, other: bool) -> TrackMoment:
    return UNKNOWN.model_copy(update={"observed": event, "warned": other})


def moments(trace: Sequence[tuple[float, dict[str, tuple[bool, bool]]]]) -> list[Moment]:
    return [
        Moment(time_s=time_s, tracks={name: track(*facts) for name, facts in seen.items()})
        for time_s, seen in trace
    ]


def told(monitor: Monitor, trace: Sequence[Moment]) -> list[tuple[int, str]]:
    """Return which track broke the ordering at which moment; -1 stands for the end."""
    found = [(n, f) for n, now in enumerate(trace) for f in monitor.observe(now)]
    found += [(-1, finding) for finding in monitor.finish()]
    return [
        (n, name)
        for n, finding in found
        for name in finding.message.removeprefix("wrong order: ").split(", ")
    ]


def naive(kind: Kind, trace: Sequence[tuple[float, dict[str, tuple[bool, bool]]]], name: str):
    """Return the moments at which the track breaks the ordering, by looking at the whole trace."""
    there = [(n, t, *seen[name]) for n, (t, seen) in enumerate(trace) if name in seen]
    wrong: set[int] = set()
    match kind:
        case "before":
            first_event = next((n for n, _, event, _ in there if event), None)
            first_other = next((n for n, _, _, other in there if other), None)
            if first_event is not None and (first_other is None or first_other > first_event):
                wrong.add(first_event)
        case "after":
            first_other = next((n for n, _, _, other in there if other), None)
            if first_other is not None and not any(e for n, _, e, _ in there if n >= first_other):
                wrong.add(-1)
        case "never_while":
            bad = {n for n, _, event, other in there if event and other}
            wrong |= {n for n in bad if n - 1 not in bad}
        case "until":
            first_other = next((n for n, _, _, other in there if other), len(trace))
            seen = [(n, event) for n, _, event, _ in there if n < first_other]
            wrong |= {
                n
                for place, (n, event) in enumerate(seen)
                if not event and (place == 0 or seen[place - 1][1])
            }
        case "within":
            wrong |= _late(trace, name)
    return wrong


def _late(trace: Sequence[tuple[float, dict[str, tuple[bool, bool]]]], name: str) -> set[int]:
    """Return where each stretch of `other` without any `event` has lasted for too long."""
    facts = [seen.get(name, (False, False)) for _, seen in trace]
    wrong: set[int] = set()
    for start, (_, other) in enumerate(facts):
        if not other or (start > 0 and facts[start - 1][1]):
            continue
        for later in range(start, len(facts)):
            if trace[later][0] > trace[start][0] + LIMIT_S:
                wrong.add(later)
                break
            if facts[later][0] or not facts[later][1]:
                break
    return wrong


facts = st.tuples(st.booleans(), st.booleans())
stretches = st.lists(
    st.tuples(
        st.sampled_from([0.5, 1.0, 3.0, 4.0]),
        st.integers(1, 3),
        st.one_of(
            st.fixed_dictionaries({"V1": facts}),
            st.dictionaries(st.sampled_from(["V1", "V2"]), facts, max_size=2),
        ),
    ),
    max_size=8,
)


def timed(drawn: list[tuple[float, int, dict[str, tuple[bool, bool]]]]):
    """Return the trace of stretches in which nothing changes: (step, how many, what is seen)."""
    total, trace = 0.0, list[tuple[float, dict[str, tuple[bool, bool]]]]()
    for step, times, seen in drawn:
        for _ in range(times):
            total += step
            trace.append((total, seen))
    return trace


@pytest.mark.parametrize("kind", get_args(Kind))
@settings(max_examples=200, deadline=None)
@given(stretches.map(timed))
def test_moment_by_moment_is_the_same_as_the_whole_trace_at_once(
    kind: Kind, trace: list[tuple[float, dict[str, tuple[bool, bool]]]]
) -> None:
    monitor = Monitor(book_of(kind, "track", "it.observed", "it.warned"), WORLD)
    expected = {(n, name) for name in ("V1", "V2") for n in naive(kind, trace, name)}
    assert set(told(monitor, moments(trace))) == expected


def test_what_was_done_in_time_need_not_be_done_again_until_its_cause_begins_anew() -> None:
    both, cause, neither = (True, True), (False, True), (False, False)
    facts_at = [(0.0, both), (1.0, cause), (9.0, cause), (10.0, neither), (11.0, cause)]
    trace = [(t, {"V1": facts}) for t, facts in [*facts_at, (17.0, cause), (30.0, cause)]]
    monitor = Monitor(book_of("within", "track", "it.observed", "it.warned"), WORLD)
    assert told(monitor, moments(trace)) == [(5, "V1")]


@pytest.mark.parametrize("kind", get_args(Kind))
@settings(max_examples=40, deadline=None)
@given(stretches.map(timed), st.integers(0, 14))
def test_a_copy_goes_on_as_the_original_would_and_leaves_it_alone(
    kind: Kind, trace: list[tuple[float, dict[str, tuple[bool, bool]]]], cut: int
) -> None:
    seen = moments(trace)
    original = Monitor(book_of(kind, "track", "it.observed", "it.warned"), WORLD)
    for now in seen[:cut]:
        original.observe(now)
    first, second = original.copy(), original.copy()
    assert told(first, seen[cut:]) == told(second, seen[cut:]) == told(original, seen[cut:])


@pytest.mark.parametrize("kind", get_args(Kind))
@settings(max_examples=40, deadline=None)
@given(stretches.map(timed))
def test_speaking_of_the_whole_moment_finds_the_same_as_speaking_of_the_subject(
    kind: Kind, trace: list[tuple[float, dict[str, tuple[bool, bool]]]]
) -> None:
    own = book_of(kind, "track", "it.observed", "it.warned")
    whole = book_of(kind, "track", "now.tracks[id].observed", "now.tracks[id].warned")
    seen = moments(trace)
    assert sorted(told(Monitor(own, WORLD), seen)) == sorted(told(Monitor(whole, WORLD), seen))


def covered(time_s: float, **gates: bool) -> Moment:
    return Moment(time_s=time_s, covered=dict.fromkeys(WORLD.gates, True) | gates)


def test_a_lost_gate_must_be_covered_again_within_what_the_world_allows() -> None:
    monitor = Monitor(checkpoint_rules(), WORLD)
    late = WORLD.coverage_grace_s + 0.5
    assert monitor.observe(covered(0.0)) == ()
    assert monitor.observe(covered(10.0, SouthGate=False)) == ()
    assert {(p.rule_id, p.subject, p.due_s) for p in monitor.pending} == {
        ("WF-03", "SouthGate", 10.0 + WORLD.coverage_grace_s),
        ("WF-07", "SouthGate", None),
    }
    (broken,) = monitor.observe(covered(10.0 + late, SouthGate=False))
    assert broken.rule_id == "WF-03"
    assert "SouthGate" in broken.message
    assert monitor.observe(covered(11.0 + late, SouthGate=False)) == ()
    assert [finding.rule_id for finding in monitor.finish()] == ["WF-07"]
    monitor.observe(covered(99.0))
    assert monitor.finish() == ()
    assert monitor.pending == ()


def test_who_goes_on_without_running_limits_is_not_blamed_for_a_gap_that_was_there() -> None:
    monitor = Monitor(checkpoint_rules(), WORLD)
    monitor.observe(covered(0.0))
    monitor.observe(covered(10.0, SouthGate=False))
    ahead = monitor.copy(running_limits=False)
    assert ahead.observe(covered(60.0, SouthGate=False)) == ()
    assert ahead.observe(covered(61.0)) == ()
    assert ahead.observe(covered(62.0, SouthGate=False)) == ()
    assert [f.rule_id for f in ahead.observe(covered(99.0, SouthGate=False))] == ["WF-03"]
    assert [f.rule_id for f in monitor.observe(covered(60.0, SouthGate=False))] == ["WF-03"]


def test_several_subjects_and_orderings_of_a_rule_make_one_finding() -> None:
    monitor = Monitor(checkpoint_rules(), WORLD)
    wrong = UNKNOWN.model_copy(update={"warned": True, "blocked": True})
    findings = monitor.observe(Moment(time_s=0.0, tracks={"V1": wrong, "V2": wrong}))
    assert [f.rule_id for f in findings] == ["ROE-02", "ROE-10", "WF-01"]
    assert findings[2].message == (
        "warned before it was identified: V1, V2; blocked without a confirmed threat: V1, V2"
    )


@pytest.mark.parametrize(
    "order",
    [
        {"event": "now.tracks['V9'].observed"},
        {"event": "id"},
        {"event": "it.nosuchfield"},
        {"kind": "within", "seconds": "world.nosuchfield"},
        {"kind": "within", "seconds": "0.0 - world.standoff_m"},
        {"kind": "within", "seconds": "world.base"},
    ],
)
def test_an_ordering_that_cannot_decide_is_an_error_at_every_moment(
    tmp_path: Path, order: dict[str, Any]
) -> None:
    entry = {"kind": "before", "each": "track", "event": "it.warned", "other": "it.observed"}
    path = write_rules(tmp_path, {"order": [entry | {"message": "wrong"} | order]})
    monitor = Monitor(load_rules(path), WORLD)
    now = Moment(time_s=0.0, tracks={"V1": UNKNOWN})
    for time_s in (0.0, 1.0):
        (found,) = monitor.copy().observe(now.model_copy(update={"time_s": time_s}))
        assert (found.status, found.blocking) == ("error", True)
        assert monitor.observe(now) == (found,)
