"""Orders that are typed for the operator: earlier orders, favourites, and choices on the map.

A chosen order is typed into the mission field and is a mission only after the operator sends it.
The one exception is manual control, which is taken and given back at once.
"""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import yaml
from pydantic import Field
from textual.geometry import Offset

from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document, DocumentError, read_text
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.telemetry import Picture
from pa_console.session.log.chain import LogError
from pa_console.session.past_sessions import newest_logs, summarise
from pa_console.settings.sources import changed_text, settings_file, write_atomically
from pa_console.tui.controllers.browsing import BrowsingController
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController
from pa_console.tui.order_templates import templates
from pa_console.tui.screens.compose import (
    GIVE,
    MAP_CHOICES,
    Card,
    CardChoice,
    ChoiceLine,
    ChooseLine,
    asset_choices,
    asset_lines,
    frame_choices,
    track_choices,
    track_lines,
)
from pa_console.tui.status_words import KIND_WORDS
from pa_console.tui.widgets.alarms import AlarmPane
from pa_console.tui.widgets.assets import AssetTable
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionPrompt
from pa_console.tui.widgets.row_views import VirtualRows

HEAD = "# Favourite orders of PA Console; a word in braces, like {gate}, is a slot.\n"
MOST_KEPT = 200

MOST_SESSIONS = 50
"""The maximum number of sessions that are read, newest first."""

TEMPLATE, FAVOURITE = "template", "favourite"


class _Kept(StrictModel):
    """The content of the favourites file."""

    orders: tuple[str, ...] = Field(default=(), max_length=MOST_KEPT)


def favourites_file() -> Path:
    """Return the path of the user's favourites file, in the folder of the settings."""
    return settings_file().with_name("favourites.yaml")


class Favourites:
    """Favourite orders, oldest first; other content of the file is left unchanged."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def orders(self) -> tuple[str, ...]:
        """Return the orders that are in the file now.

        Raises DocumentError, which names the file and the line, for a file that cannot be used.
        """
        if not self.file.exists():
            return ()
        document = Document.read(self.file)
        if document.value is None:
            return ()
        if isinstance(document.value, dict) and document.value.get("orders", ()) is None:
            return ()
        kept = document.parse(_Kept).orders
        for number, order in enumerate(kept):
            if not order.strip() or len(order) > MAX_MISSION_TEXT:
                problem = f"expected an order of 1 to {MAX_MISSION_TEXT} characters"
                raise document.error(("orders", number), problem)
        return kept

    def keep(self, order: str) -> bool:
        """Add an order; return whether it is new.

        Raises DocumentError for a file that cannot be used, OSError for one that cannot be written,
        and ValueError if there are too many orders. The file is unchanged after an error.
        """
        kept = self.orders()
        if order in kept:
            return False
        if len(kept) >= MOST_KEPT:
            raise ValueError(f"{MOST_KEPT} favourites are kept; remove one first")
        self._write((*kept, order))
        return True

    def remove(self, order: str) -> None:
        """Remove an order; raise the same errors as `keep`."""
        self._write(tuple(kept for kept in self.orders() if kept != order))

    def _write(self, orders: tuple[str, ...]) -> None:
        path = self.file.resolve()  # keep a symbolic link to the file
        text = read_text(path) if path.exists() else HEAD
        changed = changed_text(str(path), text, "orders", list(orders))
        if tuple(yaml.safe_load(changed)["orders"]) != orders:
            raise DocumentError(str(path), 0, "orders", "could not be written as they are")
        write_atomically(path, changed)


class PastOrder(NamedTuple):
    """An order, with the start of its session and its last status if a log has them."""

    text: str
    session_began: datetime | None = None
    ended: str = ""

    @property
    def note(self) -> str:
        """The note beside the order: the local start time of its session, and its last status."""
        if self.session_began is None:
            return ""
        return f"{self.session_began.astimezone():%d %b %H:%M}  {self.ended or 'open'}"


def logged_orders(folder: Path) -> Iterator[list[PastOrder]]:
    """Yield the orders of each recorded session, newest first; damaged logs are left out.

    Missions that alarms started are not orders.
    """
    for log in newest_logs(folder)[:MOST_SESSIONS]:
        try:
            summary = summarise(log)
        except (LogError, OSError):
            continue
        own = (mission for mission in reversed(summary.missions) if not mission.by_alarm)
        yield [PastOrder(entry.said, summary.started, entry.status or "") for entry in own]


def merged(typed: Iterable[str], logged: Iterable[PastOrder]) -> list[PastOrder]:
    """Return each order once: first the orders `typed` at this terminal, then those of logs.

    Both are sorted from new to old. A typed order gets the note of its newest entry in a log.
    """
    notes: dict[str, PastOrder] = {}
    for order in logged:
        notes.setdefault(order.text, order)
    orders = {text: notes.get(text, PastOrder(text)) for text in typed}
    return list({**orders, **notes}.values())


class ComposingController:
    """A controller for the sources of orders; it types the chosen order."""

    def __init__(
        self,
        session: ConsoleSession,
        browsing: BrowsingController,
        commands: CommandController,
        settings: SettingsController,
        favourites: Favourites,
    ) -> None:
        self._session, self._app, self._browsing = session, session.app, browsing
        self._commands, self._settings, self._favourites = commands, settings, favourites

    # Earlier orders, favourites and templates

    def search_history(self) -> None:
        """Let the operator search the orders of this and of earlier sessions."""
        typed = self._session.typed.texts
        lines = [ChoiceLine(text) for text in typed]
        chooser = ChooseLine(
            "Earlier orders", lines, nothing="no order was given yet", more=self._with_logs
        )
        self._choose(chooser)

    def _with_logs(self) -> Iterator[list[ChoiceLine]]:
        from pa_console.session.log.writer import default_folder  # noqa: PLC0415

        folder = self._settings.loaded.values.logs or default_folder()
        logged: list[PastOrder] = []
        for orders in logged_orders(folder):
            logged += orders
            yield [
                ChoiceLine(order.text, order.note)
                for order in merged(self._session.typed.texts, logged)
            ]

    def choose_favourite(self) -> None:
        """Let the operator choose a favourite order, or a template of the world."""
        try:
            lines = self._favourite_lines()
        except (DocumentError, OSError) as error:
            self._session.tell(
                f"{error}\nNothing in the file was changed; only the templates are offered.",
                "Favourites cannot be read",
                bad=True,
            )
            lines = [ChoiceLine(text, TEMPLATE) for text in templates(self._session.world)]
        chooser = ChooseLine(
            "Favourites and templates",
            lines,
            nothing="there are no favourites or templates",
            remove=self._without,
        )
        self._choose(chooser)

    def _favourite_lines(self) -> list[ChoiceLine]:
        kept = self._favourites.orders()
        unkept = [text for text in templates(self._session.world) if text not in kept]
        return [
            *(ChoiceLine(text, FAVOURITE) for text in kept),
            *(ChoiceLine(text, TEMPLATE) for text in unkept),
        ]

    def _without(self, order: str) -> list[ChoiceLine]:
        try:
            if order not in self._favourites.orders():
                raise ValueError("a template cannot be removed")
            self._favourites.remove(order)
            return self._favourite_lines()
        except DocumentError as error:
            raise ValueError(str(error)) from error

    def keep_favourite(self) -> None:
        """Keep the order in the field, or else the last one that was sent, as a favourite."""
        main = self._session.main
        draft = main.query_one(MissionPrompt).draft.strip() if main is not None else ""
        order = draft or next(iter(self._session.typed.texts), "")
        if not order:
            self._session.tell("type or send an order first", "No favourite", bad=True)
            return
        try:
            new = self._favourites.keep(order)
        except (DocumentError, ValueError, OSError) as error:
            self._session.tell(f"{error}\nThe file was not changed.", "Not kept", bad=True)
            return
        self._session.tell(order, "Kept as a favourite" if new else "It is a favourite already")

    def _choose(self, screen: ChooseLine) -> None:
        if self._on_session:
            self._app.push_screen(screen, self._type)

    @property
    def _on_session(self) -> bool:
        """True if the session and its mission field are in front; if not, show how to get there."""
        front = self._app.screen is self._session.shown
        if not front and not isinstance(self._app.screen, ChooseLine | Card):
            self._session.tell("Esc goes back to the session, where orders are typed", "Orders")
        return front

    def _type(self, order: str | None) -> None:
        """Type an order into the mission field; undo restores the previous text."""
        main = self._session.main
        if not order or main is None:
            return
        prompt = main.query_one(MissionPrompt)
        if prompt.draft.strip() not in ("", order):
            self._session.tell("^z restores the text that was in the field", "Order typed")
        prompt.put(order)

    # Things on the map and in the table

    def choose_thing(self) -> None:
        """Let the operator choose an asset, a track or a place."""
        picture, world = self._session.shown_state.picture, self._session.world
        tracks = tuple(picture.tracks) if picture is not None else ()
        self._choose_one((*tracks, *world.frames, *world.assets))

    def row_chosen(self, message: VirtualRows.RowChosen) -> None:
        """Open the card of a row of the asset table, or follow the subject of an alarm row."""
        rows = message.rows
        if isinstance(rows, AssetTable):
            if message.key in self._session.world.cameras:
                self._browsing.follow(message.key)
            else:
                self.picked((message.key,), None, menu=False)
        elif isinstance(rows, AlarmPane) and rows.subject:
            self._browsing.follow(rows.subject)

    def picked(self, names: Sequence[str], at: Offset | None, *, menu: bool) -> None:
        """Fill the open slot of the mission field with the picked name, or else open its card.

        If several names fit, the operator chooses one. An empty place opens the menu of the map.
        """
        if self._app.screen is not self._session.shown:
            return
        main = self._session.main
        if self._may_order and main is not None and not menu:
            prompt = main.query_one(MissionPrompt)
            fitting = [name for name in names if prompt.fitting((name,)) is not None]
            if len(fitting) == 1:
                prompt.fill(fitting)
                return
            if fitting:
                self._choose_one(fitting)
                return
        if len(names) > 1:
            self._choose_one(names)
        elif names:
            self._open_card(names[0], at)
        else:
            self._app.push_screen(Card("Map", (), MAP_CHOICES, at), self._map_choice)

    @property
    def _may_order(self) -> bool:
        """True if missions can be given here."""
        now = self._session.situation
        return not (now.replay or now.readonly)

    def _choose_one(self, names: Sequence[str]) -> None:
        picture = self._session.shown_state.picture
        lines = [ChoiceLine(name, self._about(name, picture)) for name in names]

        def chosen(name: str | None) -> None:
            main = self._session.main
            if name is None:
                return
            if self._may_order and main is not None and main.query_one(MissionPrompt).fill((name,)):
                return
            self._open_card(name, None)

        if self._on_session:
            title = "Assets, tracks and places"
            self._app.push_screen(ChooseLine(title, lines, nothing="nothing is here"), chosen)

    def _about(self, name: str, picture: Picture | None) -> str:
        if picture is not None and name in picture.assets:
            asset = picture.assets[name]
            where = asset.at or f"to {asset.post}" if asset.at or asset.post else "between posts"
            return f"{KIND_WORDS[asset.kind]}, {where}, {asset.charge}"
        if picture is not None and name in picture.tracks:
            track = picture.tracks[name]
            return f"{track.identity} {track.kind} at {track.gate}"
        frame = self._session.world.frames.get(name)
        return frame.kind if frame is not None else ""

    def _open_card(self, name: str, at: Offset | None) -> None:
        picture, world = self._session.shown_state.picture, self._session.world
        lines: list[str] = []
        if picture is not None and name in picture.assets:
            asset = picture.assets[name]
            taken = self._session.shown_state.manual.get(name)
            lines = asset_lines(asset, picture, taken.by if taken is not None else "")
            choices = asset_choices(asset, taken=taken is not None)
        elif picture is not None and name in picture.tracks:
            track = picture.tracks[name]
            lines, choices = track_lines(track), track_choices(track, world)
        elif name in world.frames:
            lines, choices = [world.frames[name].kind], frame_choices(name, world)
        else:
            self._session.tell(f"there is no report of {name} yet", name, bad=True)
            return
        if not self._may_order:
            choices = [choice for choice in choices if not choice.order]

        def chosen(choice: CardChoice | None) -> None:
            if choice is not None and choice.does == "follow":
                self._browsing.follow(name)
            elif choice is not None and choice.does == GIVE:
                self._commands.attempt(choice.name, lambda station: station.submit(choice.order))
            elif choice is not None:
                self._type(choice.order)

        shown = self._session.shown
        card = Card(name, lines, choices, at, shown.read_still) if shown else Card(name, (), ())
        self._app.push_screen(card, chosen)
        if picture is not None and name in picture.tracks:
            self._app.run_worker(
                self._show_still(card, name), group="still", exclusive=True, exit_on_error=False
            )

    async def _show_still(self, card: Card, track: str) -> None:
        """Show a camera still of a track on its card; in a recording, the last logged one."""
        session = self._session
        if session.station is None or session.recording is not None:
            still = session.shown_state.stills.get(track)
        else:
            still = await session.station.still_of(track)
        if still is not None and self._app.screen is card:
            card.show_still(still, session.shown_state.time_s)

    def _map_choice(self, choice: CardChoice | None) -> None:
        if choice is not None and (shown := self._session.shown) is not None:
            view = shown.query_one(MapView)
            if choice.does == "sensors":
                view.next_sensors()
            else:
                view.zoom_by(2.0 if choice.does == "zoom_in" else 0.5)
