"""The one table of status words: each is a glyph, a word and a colour, readable without colour."""

from typing import NamedTuple

from textual.content import Content

GOOD, BAD, WARN = "$text-success", "$text-error", "$text-warning"
CALM, QUIET, NOTE = "$text-primary", "$quiet", "$text-accent"


class Term(NamedTuple):
    """How one status is shown everywhere."""

    glyph: str
    word: str
    style: str

    @property
    def content(self) -> Content:
        """The glyph and the word, coloured."""
        return Content.styled(f"{self.glyph} {self.word}", self.style)


TERMS: dict[str, Term] = {
    "finding.complies": Term("✔", "complies", GOOD),
    "finding.violates": Term("✘", "VIOLATES", BAD),
    "finding.error": Term("✘", "CHECK FAILED", BAD),
    "finding.not_applicable": Term("–", "does not apply", QUIET),
    "finding.judged_only": Term("◌", "judged only", QUIET),
    "opinion.complies": Term("✔", "complies", GOOD),
    "opinion.violates": Term("✘", "violates", BAD),
    "opinion.unclear": Term("?", "unclear", WARN),
    "verdict.Success": Term("✔", "Success", GOOD),
    "verdict.Failure": Term("✘", "FAILURE", BAD),
    "verdict.none": Term("?", "no verdict", WARN),
    "score.success": Term("✔", "success", GOOD),
    "score.failure": Term("✘", "FAILURE", BAD),
    "mission.verified": Term("✔", "verified", GOOD),
    "mission.unverified": Term("?", "not verified", WARN),
    "mission.refused": Term("✘", "refused", BAD),
    "mission.rejected": Term("✘", "rejected", WARN),
    "mission.held": Term("‖", "held", WARN),
    "mission.cancelled": Term("✘", "cancelled", WARN),
    "mission.failed": Term("✘", "failed", BAD),
    "outcome.pass": Term("✔", "pass", GOOD),
    "outcome.fail": Term("✘", "FAIL", BAD),
    "outcome.unknown": Term("?", "unknown", WARN),
    "reply.sent": Term("○", "sent", QUIET),
    "reply.acknowledged": Term("◔", "acknowledged", CALM),
    "reply.progress": Term("◑", "under way", CALM),
    "reply.done": Term("✔", "done", GOOD),
    "reply.refused": Term("✘", "REFUSED", BAD),
    "reply.failed": Term("✘", "FAILED", BAD),
    "asset.ok": Term("●", "ok", GOOD),
    "asset.degraded": Term("◐", "degraded", WARN),
    "asset.failed": Term("✘", "FAILED", BAD),
    "asset.down": Term("✘", "DOWN", BAD),
    "comms.ok": Term("●", "ok", GOOD),
    "comms.degraded": Term("◐", "weak", WARN),
    "comms.lost": Term("✘", "LOST", BAD),
    "report.fresh": Term("●", "fresh", GOOD),
    "report.stale": Term("?", "stale", WARN),
    "report.silent": Term("✘", "silent", BAD),
    "report.suspect": Term("≠", "SUSPECT", BAD),
    "camera.works": Term("▿", "works", GOOD),
    "camera.failed": Term("✘", "FAILED", BAD),
    "camera.unknown": Term("?", "unknown", WARN),
    "identity.unknown": Term("?", "unknown", WARN),
    "identity.authorized": Term("✔", "authorized", GOOD),
    "identity.unauthorized": Term("!", "UNAUTHORIZED", BAD),
    "intent.unknown": Term("?", "unknown", QUIET),
    "intent.benign": Term("✔", "benign", GOOD),
    "intent.hostile": Term("‼", "HOSTILE", BAD),
    "gate.covered": Term("◆", "covered", GOOD),
    "gate.uncovered": Term("◇", "UNCOVERED", BAD),
    "gate.unknown": Term("?", "cover unknown", WARN),
    "weather.clear": Term("○", "clear", QUIET),
    "weather.rain": Term("∴", "rain", WARN),
    "weather.fog": Term("≋", "fog", WARN),
    "alarm.emergency": Term("■", "EMERGENCY", BAD),
    "alarm.high": Term("▲", "HIGH", BAD),
    "alarm.medium": Term("△", "medium", WARN),
    "alarm.low": Term("▽", "low", CALM),
    "alarm.none": Term("·", "no alarm", QUIET),
    "seen.new": Term("●", "NEW", NOTE),
    "seen.seen": Term("✔", "seen", QUIET),
    "level.info": Term("·", "info", QUIET),
    "level.warning": Term("▲", "warning", WARN),
    "level.alarm": Term("■", "ALARM", BAD),
    "mark.mission": Term("◆", "mission", NOTE),
    "mark.finding": Term("△", "finding", WARN),
    "mark.alarm": Term("▲", "alarm", BAD),
    "mark.refusal": Term("✘", "refusal", BAD),
    "mark.fault": Term("‼", "fault", BAD),
    "worker.loading": Term("◔", "loading", WARN),
    "worker.ready": Term("●", "ready", GOOD),
    "worker.dead": Term("✘", "restarting", BAD),
    "worker.unavailable": Term("✘", "unavailable", BAD),
    "worker.none": Term("?", "unknown", WARN),
    "priority.critical": Term("▲", "critical", BAD),
    "priority.high": Term("△", "high", WARN),
    "priority.medium": Term("▽", "medium", CALM),
    "rule.checked": Term("■", "checked", CALM),
    "rule.judged": Term("□", "judged only", QUIET),
    "phase.done": Term("✔", "done", GOOD),
    "phase.current": Term("▶", "now", NOTE),
    "phase.skipped": Term("–", "skipped", QUIET),
    "phase.pending": Term("·", "to come", QUIET),
    "step.done": Term("✔", "done", GOOD),
    "step.active": Term("▶", "under way", NOTE),
    "step.pending": Term("·", "to come", QUIET),
}


def term(family: str, value: str) -> Term:
    """Return how `value` of `family` is shown; a value not in the table is shown as unknown."""
    return TERMS.get(f"{family}.{value}", Term("?", value, WARN))
