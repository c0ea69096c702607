"""The operator's own plan over HTTP keeps the order of its steps."""

from pa_console.http.bodies import ActionBody, plan_of


def test_a_plan_of_the_operators_own_keeps_its_steps() -> None:
    bodies = (
        ActionBody(agent="Robot_T01", command="move_to NorthGate", stay_s=5.0),
        ActionBody(agent="Ugv_T02", command="return_to_base", after=[1]),
    )
    plan = plan_of(bodies, "")
    assert plan.steps == ((1,), (2,))
    assert plan.actions[0].stay_s == 5.0
