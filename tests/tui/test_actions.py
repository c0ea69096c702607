"""Every action of the registry is carried out: by one controller, or by Textual itself."""

from typing import Any, get_type_hints
from unittest.mock import create_autospec

import pytest

from pa_console.tui.actions import ACTIONS, ActionContext, action_of, find_action
from pa_console.tui.app import ConsoleApp
from pa_console.tui.controllers.controllers import HANDLERS, Controllers


def test_an_action_is_carried_out_by_one_controller_or_by_textual() -> None:
    made: dict[str, Any] = {
        name: create_autospec(kind, instance=True)
        for name, kind in get_type_hints(Controllers).items()
    }
    for action in ACTIONS:
        if action.app_action:
            assert callable(getattr(ConsoleApp, f"action_{action.app_action}"))
            assert action.id not in HANDLERS
            continue
        before = sum(len(controller.method_calls) for controller in made.values())
        HANDLERS[action.id](Controllers(**made))
        after = sum(len(controller.method_calls) for controller in made.values())
        assert after == before + 1, action.id
    assert HANDLERS.keys() <= {action.id for action in ACTIONS}


def test_textual_finds_each_action_by_what_it_is_bound_to() -> None:
    for action in ACTIONS:
        name, _, rest = action.action.partition("(")
        parameters = (action.id,) if rest else ()
        assert find_action(name, parameters) is action
        assert callable(getattr(ConsoleApp, f"action_{name}"))
    assert find_action("carry_out", ("nothing",)) is None


@pytest.mark.parametrize("word", ["export", "session", "replay", "history"])
def test_the_palette_finds_recorded_sessions_by_what_people_call_them(word: str) -> None:
    sessions = action_of("sessions")
    found = [action for action in ACTIONS if word in f"{action.help} {action.words}".lower()]
    assert sessions in found
    assert sessions.palette
    assert not sessions.refusal(ActionContext())
