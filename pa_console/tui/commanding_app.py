"""The half of the app that gives orders about alarms, the queue, the mission and the simulation."""

from collections.abc import Callable

from pa_console.schema.incident import Incident
from pa_console.tui.actions import first_key
from pa_console.tui.protocols import LiveStation
from pa_console.tui.replaying_app import ReplayingApp
from pa_console.tui.widgets.alarms import AlarmPane


class CommandingApp(ReplayingApp):
    """Carries out the registry's actions that the station may refuse; a refusal is shown."""

    def attempt(self, title: str, command: Callable[[LiveStation], object]) -> bool:
        """Give a command; returns whether it was taken."""
        if self.station is None or self.readonly:
            self.tell("the console is read-only", f"{title} refused", bad=True)
            return False
        try:
            command(self.station)
        except ValueError as error:
            self.tell(str(error), f"{title} refused", bad=True)
            return False
        return True

    def action_acknowledge(self) -> None:
        """Acknowledge the alarm at the pointer, else the worst that nobody has seen."""
        if self.main is None:
            return
        pane = self.main.query_one(AlarmPane)
        item = pane.alarm
        if item is not None:
            name = item.alarm.id
            if self.attempt("Acknowledge", lambda station: station.acknowledge(name)):
                pane.release()

    def action_move_queued(self, by: int) -> None:
        """Move the waiting mission at the pointer by one place."""
        self._with_queued("Move", lambda station, name: station.move(name, by))

    def action_defer_queued(self) -> None:
        """Let every other mission go before the one at the pointer."""
        self._with_queued("Defer", lambda station, name: station.defer(name))

    def action_withdraw_queued(self) -> None:
        """Take the mission at the pointer out of the queue."""
        self._with_queued("Withdraw", lambda station, name: station.withdraw(name))

    def _with_queued(self, title: str, command: Callable[[LiveStation, str], None]) -> None:
        """Give a command about the waiting mission at the pointer, once the operator sees which.

        With the pointer elsewhere or out of sight nothing is done but to show it.
        """
        if self.main is None:
            return
        pane = self.main.query_one(AlarmPane)
        name = pane.mission
        if name and pane.region.area:
            self.attempt(title, lambda station: command(station, name))
            return
        self.main.focus_view("alarms")
        if not name:
            pane.next_mission()
        self.tell(f"the pointer is on {pane.mission} now; press the key again", title)

    def inject(self, incident: Incident) -> None:
        """Make something happen in the simulation."""
        self.attempt("What-if", lambda station: station.inject(incident))

    def action_cancel_mission(self) -> None:
        """Cancel the active mission at once."""
        self.attempt("Cancel", lambda station: station.cancel())

    def action_stop_all(self) -> None:
        """Make every asset hold, at once and without a question."""
        if self.attempt("Stop", lambda station: station.stop_all()):
            self.tell(
                "every asset was told to hold, open plans are void, the queue is empty; "
                "the red line at the top says who has confirmed. Nothing else is sent until you "
                f"release the stop ({first_key('release')})",
                "■ ALL STOPPED",
                bad=True,
            )

    def action_release_stop(self) -> None:
        """Release the stop, after a question that says who has not confirmed it."""
        stop = self.state.stop
        if stop is None:
            return
        from pa_console.tui.screens.questions import Confirm  # noqa: PLC0415

        doubtful = f"Not confirmed: {', '.join(stop.unconfirmed)}.\n" if stop.unconfirmed else ""
        question = (
            f"Everything was stopped by {stop.by}. {stop.held} assets confirmed that they hold.\n"
            f"{doubtful}Released, the console takes missions again and alarms become missions.\n"
            "No asset moves before you approve a plan."
        )

        def answered(release: bool | None) -> None:
            if release and self.attempt("Release", lambda station: station.release()):
                self.tell("missions are taken again", "The stop was released")

        self.push_screen(Confirm(question, yes="Release", no="Stay stopped"), answered)
