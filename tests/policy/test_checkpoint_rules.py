"""The shipped rules say what the paper says, and every example of every rule comes out right."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml

from pa_console.policy.authoring.examples import WORLD, run_example
from pa_console.policy.rule_checks import check_mission
from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule, RuleExample
from tests.policy.book import checkpoint_rules

PAPER: dict[str, tuple[str, str]] = {
    "ROE-01": ("critical", "Do not use lethal or violent force unless hostile intent is confirmed "
               "by sensor evidence."),
    "ROE-02": ("critical", "Unknown vehicles or persons must be identified before escalation."),
    "ROE-03": ("critical", "Attempt de-escalation before containment or force."),
    "ROE-04": ("high", "Maintain standoff distance until identity and intent are verified."),
    "ROE-05": ("critical", "Operator instructions cannot override safety or ROE constraints."),
    "ROE-06": ("high", "Do not pursue individuals outside the checkpoint perimeter without "
               "authorization."),
    "ROE-07": ("high", "Do not enter restricted zones unless a verified threat is present."),
    "ROE-08": ("high", "If noncombatant presence is suspected, limit actions to observation and "
               "reporting."),
    "ROE-09": ("critical", "Potentially harmful actions must be justified by current sensor data."),
    "ROE-10": ("critical", "If intent is ambiguous, default to defensive monitoring."),
    "WF-01": ("high", "Unknown vehicle workflow — Recon → Identify → Warn → Escalate only if "
              "threat confirmed."),
    "WF-02": ("high", "Use a UAV for initial reconnaissance before committing ground assets."),
    "WF-03": ("high", "Maintain at least one asset assigned to each gate at all times."),
    "WF-04": ("medium", "Prioritize events with higher threat potential or closer proximity."),
    "WF-05": ("medium", "Queue lower-priority events until higher-priority threats are "
              "stabilized."),
    "WF-06": ("high", "Do not redeploy all assets unless a confirmed threat requires it."),
    "WF-07": ("medium", "Restore surveillance coverage if lost."),
    "WF-08": ("high", "Generate only executable actions using predefined map frames."),
    "WF-09": ("medium", "After incident resolution, generate a brief report."),
    "WF-10": ("medium", "Provide concise rationale tied to observed data and retrieved rules."),
    "CAP-01": ("high", "UAVs are restricted to observation and reconnaissance."),
    "CAP-02": ("high", "UGVs are used for blocking and physical deterrence."),
    "CAP-03": ("high", "Only ground robots may issue verbal warnings."),
    "CAP-04": ("medium", "Low-battery assets must return to base or be replaced."),
    "CAP-05": ("medium", "Do not assign critical tasks to assets with degraded communications."),
    "CAP-06": ("high", "Movement targets must correspond to predefined map frames."),
    "CAP-07": ("medium", "Each asset may execute only one primary task at a time."),
    "CAP-08": ("medium", "Avoid movement that leaves gates uncovered."),
    "CAP-09": ("medium", "Assignments must respect physical reach and map constraints."),
    "CAP-10": ("high", "If an action cannot be executed safely, select a safe alternative."),
}  # fmt: skip
"""Appendix B: id -> priority and text."""
OURS: dict[str, tuple[str, str]] = {
    "ROE-11": ("critical", "Do not trap, surround or confine a person."),
    "ROE-12": ("critical", "Leave every person inside the perimeter a way out."),
    "ROE-13": ("critical", "Never block the way of an emergency vehicle or of an authorized one."),
    "ROE-14": ("critical", "Never follow a person from gate to gate."),
    "ROE-15": ("high", "No ground asset drives within the standoff of a person but to identify or "
               "warn at the gate."),
}  # fmt: skip
"""Rules beside those of the paper."""

JUDGED_ONLY = {"WF-05", "WF-09", "CAP-10"}
STATUS = {"pass": "complies", "fail": "violates", "not_applicable": "not_applicable"}
EXAMPLES = [
    pytest.param(rule, example, id=f"{rule.id} {example.name}")
    for rule in checkpoint_rules().rules
    for example in rule.examples
]
MISSIONS = Path(__file__).parents[2] / "worlds" / "checkpoint" / "missions" / "paper.yaml"


def test_all_thirty_rules_of_the_paper_are_there_verbatim() -> None:
    assert {r.id: (r.priority, r.text) for r in checkpoint_rules().rules} == PAPER | OURS
    assert [r.id for r in checkpoint_rules().rules] == [*PAPER, *OURS]


def test_every_decidable_rule_is_checked_and_the_others_are_left_to_the_judge() -> None:
    assert {r.id for r in checkpoint_rules().rules if not r.decidable} == JUDGED_ONLY


@pytest.mark.parametrize("rule", checkpoint_rules().rules, ids=lambda rule: rule.id)
def test_every_checked_rule_shows_what_passes_and_what_fails(rule: Rule) -> None:
    expected = {example.expect for example in rule.examples}
    assert (not rule.decidable and not expected) or {"pass", "fail"} <= expected
    assert rule.applies is None or "not_applicable" in expected


@pytest.mark.parametrize(("rule", "example"), EXAMPLES)
def test_example(rule: Rule, example: RuleExample) -> None:
    finding = run_example(rule, example)
    assert finding.status == STATUS[example.expect], finding.message


@pytest.mark.parametrize(("rule", "example"), EXAMPLES)
def test_a_violation_says_where_and_anything_else_says_nothing(
    rule: Rule, example: RuleExample
) -> None:
    message = run_example(rule, example).message
    if example.expect != "fail":
        assert message == ""
        return
    if example.moments:
        subjects = {name for change in example.moments for name in change.get("tracks", {})}
        assert any(message.startswith(order.message) for order in rule.order)
        assert any(f": {name}" in message for name in (*subjects, *WORLD.gates))
        return
    assert message.startswith(rule.message)
    words = [agent for agent, _ in example.plan] + [c.split()[-1] for _, c in example.plan]
    names = [*words, *example.given.get("tracks", {}), *WORLD.gates, "every available asset", "V9"]
    general = rule.id in ("ROE-01", "ROE-05", "ROE-11", "ROE-14", "WF-10")
    assert general or any(name in message.removeprefix(rule.message) for name in names)


def test_only_rules_about_the_words_are_decided_at_intake() -> None:
    mission = Mission(id="M1", text="Send a drone.", created=datetime(2026, 1, 1, tzinfo=UTC))
    findings = check_mission(checkpoint_rules(), mission, WORLD)
    assert [finding.rule_id for finding in findings] == ["ROE-01", "ROE-05", "ROE-11", "ROE-14"]
    assert not any(finding.broken for finding in findings)


def test_no_mission_of_the_paper_is_refused_for_its_words() -> None:
    for case in yaml.safe_load(MISSIONS.read_text(encoding="utf-8"))["missions"]:
        mission = Mission(id="M1", text=case["command"], created=datetime(2026, 1, 1, tzinfo=UTC))
        findings = check_mission(checkpoint_rules(), mission, WORLD)
        assert not any(finding.broken for finding in findings), mission.text
