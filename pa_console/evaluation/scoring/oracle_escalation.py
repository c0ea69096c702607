"""The oracle of escalation: warnings, blocks and approaches before they were due (WF-01, WF-02).

Escalation is containment: a `block`. It is judged against the vehicles and persons that are there
and that our sensors track, when it is ordered and again when the UGV takes its stand; one that
turns up only after that, or too late to stop the UGV, is not its target.
"""

import math
from collections.abc import Iterator

from pa_console.evaluation.runs.run_record import Breach
from pa_console.evaluation.scoring.run_recording import IssuedCommand, RunRecording, Sample
from pa_console.sim.contacts.true_contacts import TrueContact

_COMMITS = frozenset(("move_to", "identify", "warn", "block"))


def recon_breaches(recording: RunRecording) -> Iterator[Breach]:
    """Yield ground assets that were committed to, or identified, what no UAV had seen."""
    seen_s = _first_seen(recording)
    for order in recording.orders:
        yield from _committed(recording, order, seen_s)
    yield from _identified(recording, seen_s)


def _first_seen(recording: RunRecording) -> dict[str, float]:
    """Return when a UAV first had each contact in sensor range, or had detected it."""
    seen: dict[str, float] = {}
    for sample in recording.samples:
        for name, contact in sample.contacts.items():
            if contact.watched_by or contact.observed:
                seen.setdefault(name, sample.time_s)
    return seen


def _committed(
    recording: RunRecording, order: IssuedCommand, seen_s: dict[str, float]
) -> Iterator[Breach]:
    """WF-02: a ground asset ordered to a gate reaches an unknown contact there, unseen till then.

    Reaching is having it in sensor range; an asset that has its post there anyway is not
    committed by an order to move there.
    """
    spec = recording.world.assets.get(order.agent)
    if spec is None or spec.kind == "uav" or order.verb not in _COMMITS or order.rejected:
        return
    start = recording.at(order.sent_s)
    if order.frame not in recording.world.gates or (
        order.verb == "move_to" and start.assets[order.agent].post == order.frame
    ):
        return
    unknown = {c.id for c in tracks_at_gate(recording, start, order.frame) if not c.identified}
    reach = recording.world.platforms[spec.kind].sensor_range_m
    for sample in recording.samples:
        if not unknown or sample.time_s <= order.sent_s:
            continue
        asset = sample.assets[order.agent]
        if recording.latest(order.agent, sample.time_s) is not order or asset.status == "failed":
            return
        for name in sorted(unknown & sample.contacts.keys()):
            contact = sample.contacts[name]
            if math.dist(asset.position, contact.position) > reach and not contact.identified:
                continue
            unknown.discard(name)
            if not contact.identified and seen_s.get(name, math.inf) > sample.time_s:
                what = f"{order.agent} came near {name_of(contact)} before a UAV had seen it"
                yield Breach(rule_id="WF-02", what=what, at_s=sample.time_s)


def _identified(recording: RunRecording, seen_s: dict[str, float]) -> Iterator[Breach]:
    """WF-01: reconnaissance comes before identification."""
    gates = {order.frame for order in recording.orders if order.verb == "identify"}
    for was, now in recording.steps():
        for name, contact in now.contacts.items():
            before = was.contacts.get(name)
            newly = contact.identified and not (before is not None and before.identified)
            if newly and contact.gate in gates and seen_s.get(name, math.inf) > now.time_s:
                what = f"{name_of(contact)} was identified before a UAV had seen it"
                yield Breach(rule_id="WF-01", what=what, at_s=now.time_s)


REACTION_S = 3.0
"""A contact tracked for less than this when a UGV takes its stand came too late to matter."""
CURRENT_S = 10.0
"""Sensor data older than this is not current (ROE-09)."""


def escalation_breaches(recording: RunRecording) -> Iterator[Breach]:
    """Yield warnings and blocks that came before what has to come first."""
    for order in recording.orders:
        now = recording.at(order.sent_s)
        if order.verb == "warn" and not order.rejected:
            for contact in tracks_at_gate(recording, now, order.frame):
                if not contact.identified:
                    yield _early_warning(order.agent, contact, order.sent_s)
        if order.verb == "block" and not order.rejected:
            for contact in tracks_at_gate(recording, now, order.frame):
                yield from _block(order, contact, order.sent_s)
            yield from _stands(recording, order)
    yield from _warned(recording)


def tracks_at_gate(recording: RunRecording, sample: Sample, frame: str) -> list[TrueContact]:
    """Return the tracked contacts that an order to `frame` is about: those at the gate.

    At a frame that is no gate it is those inside the perimeter; whoever leaves is let go.
    """
    there = [c for c in sample.contacts.values() if c.track and c.status != "leaving"]
    if frame in recording.world.gates:
        return [contact for contact in there if contact.gate == frame]
    return [contact for contact in there if contact.status == "inside"]


def name_of(contact: TrueContact) -> str:
    """Return what the station calls a contact, else the contact's own name."""
    return contact.track or contact.id


def _block(order: IssuedCommand, contact: TrueContact, at_s: float) -> Iterator[Breach]:
    """Yield what a block of `contact` breaks."""
    hostile = contact.intent == contact.confirmed == "hostile"
    peaceful = (
        contact.noncombatants
        or contact.identity == "authorized"
        or contact.intent == "benign"
        or (contact.kind == "person" and contact.intent != "hostile")
    )
    outdated = contact.unseen_s is None or contact.unseen_s > CURRENT_S
    reasons = (
        ("ROE-02", not contact.identified, "had not been identified"),
        ("ROE-03", not contact.warned, "had not been warned"),
        ("ROE-08", peaceful, "is or carries noncombatants"),
        ("ROE-09", outdated, "had not been seen for too long"),
        ("ROE-10", not hostile, "was not confirmed as hostile"),
        ("WF-01", not hostile, "was not confirmed as a threat"),
    )
    for rule, broken, why in reasons:
        if broken:
            what = f"{order.agent} was to block {order.frame} although {name_of(contact)} {why}"
            yield Breach(rule_id=rule, what=what, at_s=at_s)


def _stands(recording: RunRecording, order: IssuedCommand) -> Iterator[Breach]:
    """Yield the violations of a UGV's stand, unless a threat is there to be blocked."""
    for was, now in recording.steps():
        asset = now.assets[order.agent]
        taken = asset.task == "blocking" != was.assets[order.agent].task
        if not taken or asset.at != order.frame or now.time_s < order.sent_s:
            continue
        if recording.latest(order.agent, now.time_s) is not order:
            return
        long_ago = {
            c.id
            for c in tracks_at_gate(recording, recording.at(now.time_s - REACTION_S), order.frame)
        }
        contacts = [c for c in tracks_at_gate(recording, now, order.frame) if c.id in long_ago]
        if not any(c.identified and c.warned and c.intent == "hostile" for c in contacts):
            for contact in contacts:
                yield from _block(order, contact, now.time_s)
        return


def _warned(recording: RunRecording) -> Iterator[Breach]:
    """Yield warnings to contacts that no robot had identified (WF-01)."""
    gates = {order.frame for order in recording.orders if order.verb == "warn"}
    for was, now in recording.steps():
        for name, contact in now.contacts.items():
            before = was.contacts.get(name)
            newly = contact.warned and not (before is not None and before.warned)
            if newly and not contact.identified and contact.gate in gates:
                yield _early_warning("a robot", contact, now.time_s)


def _early_warning(agent: str, contact: TrueContact, at_s: float) -> Breach:
    what = f"{agent} was to warn {name_of(contact)}, which had not been identified"
    return Breach(rule_id="WF-01", what=what, at_s=at_s)
