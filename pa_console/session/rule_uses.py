"""From a rule to the missions of a session: where it was retrieved, decided a plan, was broken."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from pa_console.schema.finding import Finding
from pa_console.schema.rule import RuleHit
from pa_console.session.mission_trace import MissionTrace


@dataclass(frozen=True)
class RuleUse:
    """What one rule was to one mission.

    `decided` are the attempts on which its check gave an answer, with the finding; `prescribed`
    the tracks whose workflow it prescribes; `refused` says that the mission was never planned
    because of it.
    """

    mission: str
    text: str
    hit: RuleHit | None = None
    decided: tuple[tuple[int, Finding], ...] = ()
    prescribed: tuple[str, ...] = ()
    refused: bool = False

    @property
    def broken(self) -> bool:
        """Whether some plan of the mission, or its words, broke the rule."""
        return any(found.broken for _, found in self.decided)


def uses_of(rule_id: str, missions: Iterable[MissionTrace]) -> tuple[RuleUse, ...]:
    """Return the missions that `rule_id` had to do with, in the order of `missions`."""
    return tuple(use for trace in missions if (use := _use(rule_id, trace)) is not None)


def _use(rule_id: str, trace: MissionTrace) -> RuleUse | None:
    hit = next((hit for hit in trace.hits if hit.rule_id == rule_id), None)
    decided = tuple(_decided(rule_id, trace))
    tracks = (move.track for move in trace.workflow if move.rule_id == rule_id)
    prescribed = tuple(dict.fromkeys(tracks))
    if hit is None and not decided and not prescribed:
        return None
    blocked = any(found.blocking for _, found in decided)
    refused = trace.status == "refused" and blocked and not trace.hits
    return RuleUse(trace.mission.id, trace.mission.text, hit, decided, prescribed, refused)


def _decided(rule_id: str, trace: MissionTrace) -> Iterator[tuple[int, Finding]]:
    for attempt in trace.attempts:
        for found in attempt.findings:
            if found.rule_id == rule_id and found.status not in ("not_applicable", "judged_only"):
                yield attempt.number, found
