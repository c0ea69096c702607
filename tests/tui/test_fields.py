"""What is typed into a field stands there in the order in which the keys were pressed."""

from textual import events
from textual.app import App, ComposeResult

from pa_console.tui.widgets.fields import LineField, TextField


class Form(App[None]):
    """Two fields, the line first."""

    def compose(self) -> ComposeResult:
        """Yield the fields."""
        yield LineField("Send a robto")
        yield TextField("one: pass\ntwo: pass\nthree: pass")


def pressed(app: Form, *keys: str) -> None:
    """Let `keys` arrive together, as from a slow line or while the console is busy."""
    for key in keys:
        app.post_message(events.Key(key, key if len(key) == 1 else None))


async def test_a_letter_typed_at_once_after_a_deletion_is_kept() -> None:
    app = Form()
    async with app.run_test() as pilot:
        line, text = app.query_one(LineField), app.query_one(TextField)
        line.focus()
        await pilot.press("end")
        pressed(app, "backspace", "backspace", *"ot")
        await pilot.pause()
        assert line.value == "Send a robot"
        text.focus()
        await pilot.press("end")
        pressed(app, "ctrl+w", *"fail", "down", "end", "ctrl+w", *"fail")
        await pilot.pause()
        assert text.text == "one: fail\ntwo: fail\nthree: pass"


async def test_begin_and_end_of_a_text_have_their_keys() -> None:
    app = Form()
    async with app.run_test() as pilot:
        text = app.query_one(TextField)
        text.focus()
        await pilot.press("ctrl+end")
        assert text.cursor_location == (2, 11)
        await pilot.press("ctrl+home")
        assert text.cursor_location == (0, 0)
        await pilot.press("ctrl+shift+end", *"x")
        assert text.text == "x"
