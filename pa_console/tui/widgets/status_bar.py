"""The line at the top: live or replay, time, speed, model, and what is under way."""

from textual.content import Content
from textual.widgets import Static

from pa_console.schema.rules_seal import RulesSeal
from pa_console.session.fold import SessionState
from pa_console.tui.actions import first_key
from pa_console.tui.condition import cover_state
from pa_console.tui.vocabulary import QUIET, term
from pa_console.tui.words import clock_text, few

STALE_AFTER_S = 5.0
"""Wall seconds without telemetry after which the stream is called stale; the user may change it."""

UNLOGGED = " LOG NOT WRITTEN: NOTHING IS DISPATCHED "


class StatusBar(Static):
    """Says at a glance whether this is live, how old the picture is, and what the model does."""

    stale_after_s = STALE_AFTER_S

    def show(
        self, state: SessionState, title: str, mode: str, rate: float, silent_s: float
    ) -> None:
        """Show the session; `silent_s` is the wall time since the last telemetry."""
        wide = self.size.width >= 100
        time = clock_text(state.picture.time_s) if state.picture else "--:--"
        stale = silent_s > self.stale_after_s and mode == "LIVE"
        worker = term("worker", state.worker.state if state.worker else "none")
        parts: list[tuple[str, str] | Content | str] = []
        if wide:
            parts.append(("PA Console  ", "bold $text-primary"))
        if wide and state.active is None:
            parts.append((f"{title}  ", QUIET))
        clock = ("session ", QUIET) if mode == "REPLAY" else ""
        parts += [self._mode(mode), "  ", clock, f"{time} ", (f"×{rate:g}", QUIET)]
        if state.started is not None and (alarm := _rules_alarm(state.started.rules_seal)):
            parts += ["  ", (f" {alarm} ", "bold reverse $text-error")]
        if state.log_problem:
            parts += ["  ", (UNLOGGED, "bold reverse $text-error")]
        if stale:
            parts.append((f"  ▲ no telemetry for {silent_s:.0f} s", "bold $text-error"))
        if wide or worker.word != "ready":
            parts += [("  model ", QUIET), (f"{worker.glyph} {worker.word}", worker.style)]
        parts += ["  ", self._gates(state), "  ", self._mission(state, mode)]
        self.update(Content.assemble(*parts), layout=False)

    def _mode(self, mode: str) -> Content:
        style = {"LIVE": "bold $text-success"}.get(mode, "bold reverse $text-warning")
        return Content.styled("● LIVE" if mode == "LIVE" else f" {mode} ", style)

    def _gates(self, state: SessionState) -> Content:
        """Name the gates that are not covered; one of which nothing is known is not covered."""
        if state.picture is None:
            return Content.styled("? gates unknown", "$text-warning")
        by: dict[str, list[str]] = {"uncovered": [], "unknown": [], "covered": []}
        for name, cover in state.picture.gates.items():
            by[cover_state(cover)].append(name)
        parts: list[tuple[str, str]] = []
        for name in ("uncovered", "unknown"):
            if by[name]:
                mark = term("gate", name)
                gap = ", " if parts else ""
                words = f"{gap}{mark.glyph} {few(by[name], 2)} {mark.word}"
                parts.append((words, f"bold {mark.style}"))
        if parts:
            return Content.assemble(*parts)
        mark = term("gate", "covered")
        return Content.styled(f"{mark.glyph} all gates covered", mark.style)

    def _mission(self, state: SessionState, mode: str) -> Content:
        if state.ended:
            return Content.styled(f"session ended: {state.ended}", "$text-warning")
        if state.stop is not None:
            how = f": {first_key('release')} releases it" if mode == "LIVE" else ""
            return Content.styled(f"■ STOPPED{how}", "bold $text-error")
        if state.active is None:
            return Content.styled("no mission", QUIET)
        trace = state.missions[state.active]
        waiting = " ▲ WAITS FOR YOU" if trace.approval else ""
        phase = f" {trace.phase}:" if trace.phase else ""
        return Content.assemble(
            f"{trace.mission.id}{phase} {trace.stage}", (waiting, "bold $text-accent")
        )


def _rules_alarm(seal: RulesSeal | None) -> str:
    """Return what is wrong with the rules in force that nobody may overlook, "" for nothing."""
    if seal is None:
        return ""
    if seal.altered:
        return "RULES ALTERED"
    if seal.no_critical_check:
        return "RULES: NO CRITICAL CHECK"
    return "RULES ACCEPTED, NOT VOUCHED FOR" if seal.accepted else ""
