"""Follows the truth of a run beside what the station believes, and counts where they part."""

from pa_console.evaluation.oracle import find_breaches
from pa_console.evaluation.run_facts import Sample
from pa_console.evaluation.score import RunRecorder
from pa_console.schema.base import StrictModel
from pa_console.schema.events import event as ev
from pa_console.schema.mission import ActionOutcome, Verification
from pa_console.schema.telemetry import Picture
from pa_console.sim.checkpoint import Checkpoint

CONDUCT_RULES = frozenset(("ROE-04", "ROE-06", "ROE-07"))
"""The rules on where an asset under orders may drive or fly."""


class RunResult(StrictModel):
    """The outcome of one seeded run, by the truth."""

    covered: bool
    """No gate was without cover for longer than the grace time."""
    longest_gap_s: float
    missions: int
    plans: int
    halts: int
    passes: int
    fails: int
    unknowns: int
    false_passes: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()
    resent: int = 0


class TruthWatch:
    """Collects the true states of a run and the claims that the station makes of it."""

    def __init__(self, sim: Checkpoint) -> None:
        self._world = sim.world
        self._recorder = RunRecorder(sim, "")
        self._claims: list[tuple[Verification, Picture | None]] = []
        """Each verification, and the station's picture when its plan was begun."""
        self._picture: Picture | None = None
        self._start: Picture | None = None
        self._missions = self._halts = self._resent = 0

    def see(self, event: ev.Event) -> None:
        """Take in an event, and the truth as it is now if the event is telemetry."""
        self._recorder.see(event)
        match event.data:
            case ev.TelemetryReceived(picture=picture):
                self._picture = picture
            case ev.MissionVerified(verification=verification):
                self._claims.append((verification, self._start or self._picture))
                self._start = None
            case ev.DecisionMade(accepted=True):
                self._start = self._picture
            case ev.PlanHalted():
                self._halts += 1
                self._start = None
            case ev.MissionFinished():
                self._missions += 1
            case ev.CommandResent():
                self._resent += 1
            case _:
                pass

    def result(self) -> RunResult:
        """Return the outcome of the run so far."""
        facts = self._recorder.finish("verified")
        breaches = find_breaches(self._recorder.recording, CONDUCT_RULES)
        longest_gap_s = max(gate.longest_gap_s for gate in facts.coverage.values())
        outcomes = [claim.outcome for claim, _ in self._claims]
        return RunResult(
            covered=longest_gap_s <= self._world.coverage_grace_s,
            longest_gap_s=round(longest_gap_s, 1),
            missions=self._missions,
            plans=len(self._claims) + self._halts,
            halts=self._halts,
            passes=outcomes.count("pass"),
            fails=outcomes.count("fail"),
            unknowns=outcomes.count("unknown"),
            false_passes=tuple(
                untruth
                for claim, start in self._claims
                if claim.outcome == "pass" and start is not None
                for untruth in self._false_statements(claim, start)
            ),
            broken=tuple(f"{breach.rule_id}: {breach.what}" for breach in breaches),
            resent=self._resent,
        )

    def _false_statements(self, claim: Verification, start: Picture) -> list[str]:
        """Return what a pass claims that was true neither just before it nor just after."""
        samples = self._recorder.recording.samples
        before = self._recorder.recording.at(claim.as_of_s)
        after = next((s for s in samples if s.time_s >= claim.as_of_s - 1e-6), samples[-1])
        later = self._untrue(claim, start, after)
        return [text for text in self._untrue(claim, start, before) if text in later]

    def _untrue(self, claim: Verification, start: Picture, truth: Sample) -> list[str]:
        lost = [
            f"{gate} is not covered"
            for gate, guards in truth.cover.items()
            if start.gates[gate].covered and not guards
        ]
        return lost + [text for a in claim.actions if (text := self._untrue_action(a, truth))]

    def _untrue_action(self, action: ActionOutcome, truth: Sample) -> str:
        asset = truth.assets[action.agent]
        verb, _, target = action.command.partition(" ")
        place = self._world.base if verb == "return_to_base" else target
        if verb in ("move_to", "observe", "block", "return_to_base") and asset.at != place:
            return f"{action.agent} is not at {place}"
        if not asset.available and verb != "report":
            return f"{action.agent} is not available"
        return ""
