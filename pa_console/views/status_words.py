"""The only table of status words: each has a glyph, a word and a tone, readable without colour."""

from collections.abc import Mapping
from typing import Literal, NamedTuple

Tone = Literal["", "good", "bad", "warn", "calm", "quiet", "note"]
"""The tone of a text; each front end maps the tones to its own colours."""


class Status(NamedTuple):
    """The glyph, word and tone of one status, the same in every front end."""

    glyph: str
    word: str
    tone: Tone

    @property
    def text(self) -> str:
        """The glyph and the word."""
        return f"{self.glyph} {self.word}"


STATUSES: dict[str, Status] = {
    "finding.complies": Status("✔", "complies", "good"),
    "finding.violates": Status("✘", "VIOLATES", "bad"),
    "finding.error": Status("✘", "CHECK FAILED", "bad"),
    "finding.not_applicable": Status("–", "does not apply", "quiet"),
    "finding.judged_only": Status("◌", "judged only", "quiet"),
    "opinion.complies": Status("✔", "complies", "good"),
    "opinion.violates": Status("✘", "violates", "bad"),
    "opinion.broken": Status("✘", "broken: found by the checks", "bad"),
    "opinion.unclear": Status("?", "unclear", "warn"),
    "verdict.Success": Status("✔", "Success", "good"),
    "verdict.Failure": Status("✘", "FAILURE", "bad"),
    "verdict.none": Status("?", "no verdict", "warn"),
    "score.success": Status("✔", "success", "good"),
    "score.failure": Status("✘", "FAILURE", "bad"),
    "mission.verified": Status("✔", "verified", "good"),
    "mission.in_force": Status("✔", "approved", "good"),
    "mission.unverified": Status("?", "not verified", "warn"),
    "mission.refused": Status("✘", "refused", "bad"),
    "mission.rejected": Status("✘", "rejected", "warn"),
    "mission.held": Status("‖", "held", "warn"),
    "mission.cancelled": Status("✘", "cancelled", "warn"),
    "mission.failed": Status("✘", "failed", "bad"),
    "decision.approve": Status("✔", "approved", "good"),
    "decision.reject": Status("✘", "rejected", "warn"),
    "decision.modify": Status("✎", "modified", "note"),
    "decision.choose": Status("✎", "other reading chosen", "note"),
    "approval.approve": Status("✔", "Approve", "good"),
    "approval.narrowed": Status("△", "Narrowed by rules", "warn"),
    "approval.warned": Status("△", "Breaks a Medium rule", "warn"),
    "approval.may_be_misunderstood": Status("△", "May be misunderstood", "warn"),
    "approval.not_understood": Status("?", "Not understood", "warn"),
    "approval.judge_objects": Status("✘", "Judge objects", "bad"),
    "approval.blocked": Status("✘", "Blocked", "bad"),
    "approval.none": Status("?", "Approval needed", "warn"),
    "outcome.pass": Status("✔", "pass", "good"),
    "outcome.fail": Status("✘", "FAIL", "bad"),
    "outcome.unknown": Status("?", "unknown", "warn"),
    "outcome.halted": Status("■", "HALTED", "bad"),
    "outcome.none": Status("–", "not carried out", "quiet"),
    "reply.sent": Status("○", "sent", "quiet"),
    "reply.acknowledged": Status("◔", "acknowledged", "calm"),
    "reply.progress": Status("◑", "under way", "calm"),
    "reply.done": Status("✔", "done", "good"),
    "reply.refused": Status("✘", "REFUSED", "bad"),
    "reply.failed": Status("✘", "FAILED", "bad"),
    "asset.ok": Status("●", "ok", "good"),
    "asset.degraded": Status("◐", "degraded", "warn"),
    "asset.failed": Status("✘", "FAILED", "bad"),
    "asset.down": Status("✘", "DOWN", "bad"),
    "asset.manual": Status("⊕", "MANUAL", "warn"),
    "asset.unready": Status("◌", "not ready", "warn"),
    "comms.ok": Status("●", "ok", "good"),
    "comms.degraded": Status("◐", "weak", "warn"),
    "comms.lost": Status("✘", "LOST", "bad"),
    "report.fresh": Status("●", "fresh", "good"),
    "report.stale": Status("?", "stale", "warn"),
    "report.silent": Status("✘", "silent", "bad"),
    "report.suspect": Status("≠", "SUSPECT", "bad"),
    "camera.works": Status("▿", "works", "good"),
    "camera.failed": Status("✘", "FAILED", "bad"),
    "camera.unknown": Status("?", "unknown", "warn"),
    "identity.unknown": Status("?", "unknown", "warn"),
    "identity.authorized": Status("✔", "authorized", "good"),
    "identity.unauthorized": Status("!", "UNAUTHORIZED", "bad"),
    "intent.unknown": Status("?", "unknown", "quiet"),
    "intent.benign": Status("✔", "benign", "good"),
    "intent.hostile": Status("‼", "HOSTILE", "bad"),
    "gate.covered": Status("◆", "covered", "good"),
    "gate.uncovered": Status("◇", "UNCOVERED", "bad"),
    "gate.unknown": Status("?", "cover unknown", "warn"),
    "weather.clear": Status("○", "clear", "quiet"),
    "weather.rain": Status("∴", "rain", "warn"),
    "weather.fog": Status("≋", "fog", "warn"),
    "alarm.emergency": Status("■", "EMERGENCY", "bad"),
    "alarm.high": Status("▲", "HIGH", "bad"),
    "alarm.medium": Status("△", "medium", "warn"),
    "alarm.low": Status("▽", "low", "calm"),
    "alarm.none": Status("·", "no alarm", "quiet"),
    "seen.new": Status("●", "NEW", "note"),
    "seen.seen": Status("✔", "seen", "quiet"),
    "level.info": Status("·", "info", "quiet"),
    "level.warning": Status("▲", "warning", "warn"),
    "level.alarm": Status("■", "ALARM", "bad"),
    "mark.mission": Status("◆", "mission", "note"),
    "mark.finding": Status("△", "finding", "warn"),
    "mark.alarm": Status("▲", "alarm", "bad"),
    "mark.refusal": Status("✘", "refusal", "bad"),
    "mark.fault": Status("‼", "fault", "bad"),
    "log.verified": Status("✔", "verified", "good"),
    "log.running": Status("▶", "running", "calm"),
    "log.open": Status("?", "not closed", "warn"),
    "log.unsigned": Status("–", "not signed", "quiet"),
    "log.damaged": Status("✘", "DAMAGED", "bad"),
    "mission.open": Status("?", "not finished", "warn"),
    "worker.loading": Status("◔", "loading", "warn"),
    "worker.ready": Status("●", "ready", "good"),
    "worker.unconfined": Status("△", "not confined", "warn"),
    "worker.slow": Status("◐", "slow, busy machine", "warn"),
    "worker.dead": Status("✘", "restarting", "bad"),
    "worker.unavailable": Status("✘", "unavailable", "bad"),
    "worker.none": Status("?", "unknown", "warn"),
    "server.probing": Status("◔", "connecting", "warn"),
    "server.ready": Status("●", "ready", "good"),
    "server.unconstrained": Status("△", "not constrained", "warn"),
    "server.away": Status("✘", "away", "bad"),
    "tak.connected": Status("●", "connected", "good"),
    "tak.away": Status("✘", "away", "bad"),
    "priority.critical": Status("▲", "critical", "bad"),
    "priority.high": Status("△", "high", "warn"),
    "priority.medium": Status("▽", "medium", "calm"),
    "rule.checked": Status("■", "checked", "calm"),
    "rule.judged": Status("□", "judged only", "quiet"),
    "phase.done": Status("✔", "done", "good"),
    "phase.current": Status("▶", "now", "note"),
    "phase.skipped": Status("–", "skipped", "quiet"),
    "phase.pending": Status("·", "to come", "quiet"),
    "step.done": Status("✔", "done", "good"),
    "step.active": Status("▶", "under way", "note"),
    "step.interrupted": Status("–", "interrupted", "quiet"),
    "step.pending": Status("·", "to come", "quiet"),
}


def status_of(family: str, value: str) -> Status:
    """Return the status of `value` in `family`; an unknown value gets a question mark."""
    return STATUSES.get(f"{family}.{value}", Status("?", value, "warn"))


def outcomes_in_words(outcomes: Mapping[str, int]) -> str:
    """Return the number of missions by status, e.g. `2 verified, 1 rejected`, or `none`."""
    words = (f"{number} {status_of('mission', status).word}" for status, number in outcomes.items())
    return ", ".join(words) or "none"
