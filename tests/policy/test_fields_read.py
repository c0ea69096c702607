"""What an expression cannot notice is not converted, and nothing is decided otherwise for it."""

from datetime import UTC, datetime

import cel
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD
from pa_console.policy.expressions.expression import Expression, make_context
from pa_console.policy.rule_variables import (
    PLAN_SHAPES,
    plan_variables,
)
from pa_console.schema.mission import Mission
from tests.policy.book import checkpoint_rules
from tests.policy.situations import plans, rehearsals

MISSION = Mission(id="M1", text="See to the gates.", created=datetime(2026, 1, 1, tzinfo=UTC))
ALL = None


@pytest.mark.parametrize(
    ("source", "reads"),
    [
        ("size(actions) > 0", {"actions": {}}),
        ("actions.exists(a, a.asset != null)", {"actions": {"asset": {}}}),
        ("actions[0].asset.kind == 'uav'", {"actions": {"asset": {"kind": ALL}}}),
        ("has(actions[0].asset.kind)", {"actions": {"asset": {"kind": ALL}}}),
        ("plan.actions.all(a, a.verb in world.commands)",
         {"plan": {"actions": {"verb": ALL}}, "world": {"commands": ALL}}),
        ("before.assets.Drone_T01.at == ''", {"before": {"assets": {"at": ALL}}}),
        ("before.assets['Drone_T01'].at == ''", {"before": {"assets": {"at": ALL}}}),
        ("before.assets.all(name, name in after.assets)",
         {"before": {"assets": {}}, "after": {"assets": {}}}),
        ("assets.filter(s, s.available)[0].id == 'x'", {"assets": {"available": ALL, "id": ALL}}),
        # A loop's own name hides the variable of that name.
        ("tracks.all(assets, assets.gate == '')", {"tracks": {"gate": ALL}}),
        ("[actions.map(a, a.agent)].map(all, all.filter(x, x == 'A'))[0]",
         {"actions": {"agent": ALL}}),
        # All of a record is read by comparing, counting or yielding it, and by working out a name.
        ("assets[0] == assets[1]", {"assets": ALL}),
        ("assets[0] in assets", {"assets": ALL}),
        ("size(assets[0]) == 1", {"assets": ALL}),
        ("assets[0].size() == 1", {"assets": ALL}),
        ("'kind' in assets[0]", {"assets": ALL}),
        ("assets.all(s, s.all(key, key != 'kind'))", {"assets": ALL}),
        ("assets.all(s, s['ki' + 'nd'] == 'uav')", {"assets": ALL}),
        ("assets.map(s, s)", {"assets": ALL}),
        ("actions.map(a, a.asset)", {"actions": {"asset": ALL}}),
        ("(true ? assets[0] : assets[1]).kind == 'uav'", {"assets": ALL}),
        ("[assets[0]][0].kind == 'uav'", {"assets": ALL}),
        ("{'a': assets[0]}.a.kind == 'uav'", {"assets": ALL}),
        ("assets == [] || timeline.duration_s > 1.0",
         {"assets": ALL, "timeline": {"duration_s": ALL}}),
    ],
)  # fmt: skip
def test_an_expression_reads_what_it_can_notice(source: str, reads: object) -> None:
    assert Expression(source).reads(PLAN_SHAPES) == reads


def test_of_what_is_not_understood_everything_is_read() -> None:
    long = Expression(" + ".join(["1.0"] * 390) + " > timeline.duration_s")
    assert long.reads(PLAN_SHAPES) in ({"timeline": ALL}, {"timeline": {"duration_s": ALL}})


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(data=st.data())
def test_the_shipped_rules_decide_alike_on_the_fields_that_they_read(data: st.DataObject) -> None:
    rulebook = checkpoint_rules()
    plan = data.draw(plans())
    rehearsal = data.draw(rehearsals(plan))
    whole = plan_variables(plan, rehearsal, MISSION, WORLD)
    read = plan_variables(plan, rehearsal, MISSION, WORLD, rulebook.reads)
    contexts = make_context(whole), make_context(read)
    for part in rulebook.parts:
        for expression in (part.applies, part.check):
            if expression is not None:
                answers = [_answer(expression, context) for context in contexts]
                assert answers[0] == answers[1], (part.rule.id, expression)


def _answer(expression: Expression, context: cel.Context) -> object:
    try:
        return expression.evaluate(context)
    except Exception as error:  # what goes wrong is compared too
        return type(error), str(error)
