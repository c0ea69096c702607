"""The reasons why a gate has no guard: present and former cover, and assets that left or failed."""

from collections.abc import Iterator

from pa_console.schema.events.questions import AnswerLine
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.text.quantities import clock_text
from pa_console.session.state.fold import Notice, SessionState
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.session.wording import order_in_words

_MOST_NOTICES = 4
_GATE_NOTICES = ("covered by ", "no longer covered", "cover unknown")


def gate_lines(state: SessionState, gate: str, dt_s: float) -> Iterator[AnswerLine]:
    """Yield the facts in the picture and in the events about the cover of a gate.

    `dt_s` is the duration of a tick, in seconds.
    """
    picture = state.picture
    cover = picture.gates.get(gate) if picture is not None else None
    if picture is None or cover is None:
        yield AnswerLine(about="now", said=f"nothing has been reported of {gate} yet")
        return
    if cover.covered:
        said = (
            f"{gate} is not uncovered: {', '.join(cover.by)} cover{'s' * (len(cover.by) == 1)} it"
        )
    elif cover.unknown:
        said = f"nobody can say whether {gate} is covered"
    else:
        said = f"nobody covers {gate}"
    yield AnswerLine(about="now", said=said)
    if not cover.covered and cover.uncovered_s > 0.0:
        last = max(picture.time_s - cover.uncovered_s, 0.0)
        for_s = f"it has had no guard for {cover.uncovered_s:.0f} s"
        yield AnswerLine(about="since", said=f"{clock_text(last)}: {for_s}")
    yield from _belongs(picture, gate, cover.by)
    yield from _sent_away(state, gate)
    for notice in _told(state, gate):
        at = clock_text(notice.tick * dt_s)
        yield AnswerLine(about="told", said=f"at {at}: {notice.text}")


def _belongs(picture: Picture, gate: str, guards: tuple[str, ...]) -> Iterator[AnswerLine]:
    """Yield who has the post at the gate and does not cover it, with how that one is."""
    for name, asset in picture.assets.items():
        if gate in (asset.post, asset.at) and name not in guards:
            yield AnswerLine(about=name, said=_how(asset, gate, picture.time_s))


def _how(asset: AssetTelemetry, gate: str, now_s: float) -> str:
    if asset.status == "failed":
        return f"was at {gate} and has failed" if asset.at == gate else "has failed"
    if asset.integrity == "suspect":
        return "its telemetry cannot be right"
    if asset.comms == "lost" or asset.stale:
        return f"has been silent for {now_s - asset.stamp_s:.0f} s"
    if not asset.available:
        return "is not available"
    if asset.post == gate:
        return f"is on its way to {gate}: {asset.task}"
    return f"is at {gate}, on its way to {asset.post}" if asset.post else f"is at {gate}"


def _sent_away(state: SessionState, gate: str) -> Iterator[AnswerLine]:
    """Yield the last mission that sent a guard of the gate elsewhere, with who approved it."""
    for trace in reversed([*state.missions.values()]):
        lines = [*_left_for(trace, gate)]
        if lines:
            yield from lines
            return


def _left_for(trace: MissionTrace, gate: str) -> Iterator[AnswerLine]:
    attempt = trace.find(trace.executing) if trace.executing else None
    if attempt is None or attempt.plan is None or attempt.rehearsal is None:
        return
    cover = attempt.rehearsal.before.gates.get(gate)
    for action in attempt.plan.actions:
        leaves = action.verb == "return_to_base" or action.target not in (None, gate)
        if cover is None or action.agent not in cover.by or not leaves:
            continue
        approved = [d.decision for d in trace.decisions if d.accepted and d.decision.settles]
        by = f", approved by {approved[-1].by}" if approved else ""
        said = f"covered it until {trace.mission.id} sent it away: {order_in_words(action)}{by}"
        yield AnswerLine(about=action.agent, said=said)


def _told(state: SessionState, gate: str) -> list[Notice]:
    """Return the last notices on the cover of the gate, oldest first."""
    own = [n for n in state.notices if n.subject == gate and n.text.startswith(_GATE_NOTICES)]
    return own[-_MOST_NOTICES:]
