"""Gates that an order uncovered for longer than the grace time, or for good (WF-03)."""

from collections.abc import Iterator

from pa_console.evaluation.record import Breach
from pa_console.evaluation.scoring.film import Film, Sample


def coverage(film: Film) -> Iterator[Breach]:
    """Yield the gates that were covered at the command and lost it because a guard was sent away.

    A gate whose guard failed, or left on its own because its link was lost, is no breach. Gaps are
    measured between samples, so they may be one telemetry period longer than the grace time.
    """
    world = film.world
    limit_s = world.coverage_grace_s + world.telemetry_period_s + world.dt_s
    for gate in world.gates:
        if not film.start.cover[gate]:
            continue
        since_s, guard = 0.0, ""
        for was, now in film.steps():
            if now.cover[gate]:
                guard = ""
            elif was.cover[gate]:
                since_s, guard = was.time_s, _sent_away(film, was, now, gate)
            if guard and now.time_s - since_s > limit_s:
                what = f"{gate} was uncovered for too long because {guard} was sent away"
                yield Breach(rule_id="WF-03", what=what, at_s=now.time_s)
                break
        else:
            if guard:
                what = f"{gate} was left uncovered because {guard} was sent away"
                yield Breach(rule_id="WF-03", what=what, at_s=film.final.time_s)


def _sent_away(film: Film, was: Sample, now: Sample, gate: str) -> str:
    """Return a guard that an order took away from `gate` in this step, '' if none did."""
    leading_away = {order.command_id for order in film.orders if film.goal(order) not in {"", gate}}
    for name in was.cover[gate]:
        asset = now.assets[name]
        if asset.status != "failed" and asset.command_id in leading_away:
            return name
    return ""
