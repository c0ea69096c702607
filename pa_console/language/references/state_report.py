"""Reports of a state, *Drone_T03 is running on fumes*: compared with telemetry, and what is due.

What is due is written as an order in the words of the station's own alarms: a guard that is lost or
has not much left is replaced, anybody else with a low battery comes home. What telemetry does not
bear out is asked back about.
"""

import re
from collections.abc import Iterable
from typing import Literal

from pa_console.language.references.outcome import Unclear
from pa_console.language.references.reader import read_tokens
from pa_console.language.references.scene import Scene
from pa_console.language.verb_lexicon import find_verbs

State = Literal["low", "failed", "silent"]
_ALMOST = r"(?:nearly|almost|about|close to|practically|all but|as good as)"
_CHARGE = r"(?:battery|batteries|charge|power|juice|cells?|energy|percent|pct|%)"
_LOW = (
    rf"{_ALMOST} (?:out|flat|empty|drained|dead|dry|used up)(?: of {_CHARGE})?",
    rf"low (?:on )?{_CHARGE}",
    rf"{_CHARGE} (?:is|are|looks|seems|gets|'s) (?:(?:very|too|rather|{_ALMOST}) )?"
    "(?:low|flat|empty|dying|drained|red|gone)",
    "running (?:on fumes|low|out)",
    rf"(?:not|hardly) (?:have )?(?:got )?much {_CHARGE}",
    rf"(?:down|drops?|dropped) to \w+ {_CHARGE}",
    "needs? (?:charging|a charge|to charge)",
    rf"out of {_CHARGE}",
    r"\d+ ?(?:%|percent)",
)
_SILENT = (
    "no (?:word|signal|telemetry|contact|reply|answer|news)",
    "lost (?:contact|the link|touch|signal)",
    "(?:gone|went) (?:quiet|silent|dark|off the net)",
    "not (?:answer|answering|respond|responding|replying|heard)",
    "(?:is|stays|has been) (?:silent|quiet|mute)",
    "off the net|stopped answering|unreachable",
)
_FAILED = (
    "died|dead|failed|failing|crashed|conked out|kaput|bust|quit|wrecked|stuck",
    "broken?(?: down)?|broke(?: down)?|packed (?:it )?in|fell (?:over|down|out)",
    "(?:gave|given) (?:up|out)|out of (?:order|action|service)|does not (?:move|get up)",
    "not working|stopped working|(?:is|went|gone) down|done for|had it|wrong with",
)
_STATES: tuple[tuple[State, re.Pattern[str]], ...] = (
    ("low", re.compile(rf"\b(?:{'|'.join(_LOW)})(?!\w)")),
    ("silent", re.compile(rf"\b(?:{'|'.join(_SILENT)})\b")),
    ("failed", re.compile(rf"\b(?:{'|'.join(_FAILED)})\b")),
)
_VAGUE = re.compile(
    r"\b(?:do something|sort (?:it|that|this|something)(?: out)?|see to it|take care|deal with it"
    r"|fix (?:it|that|this)|handle (?:it|this|that)|what now|act on it)\b"
)
_IF = re.compile(r"\b(?:if|when|unless|in case|once|should|until|before)\b")
_ORDER = frozenset(("send", "go", "move", "put", "bring", "get", "let", "have", "take", "swap"))


def reported_state(text: str) -> State | None:
    """Return which state of an asset `text` reports, None where it asks for something, or asks.

    A vague request, *sort it out*, asks for nothing that is not due anyway.
    """
    low = " ".join(token.word for token in read_tokens(text))
    if _IF.search(low) or "?" in _VAGUE.sub("", low).replace("does not it ?", ""):
        return None
    bare = _VAGUE.sub(" ", low)
    state: State | None = next((one for one, pattern in _STATES if pattern.search(bare)), None)
    if state is None:
        return None
    left = bare
    for _, pattern in _STATES:
        left = pattern.sub(" ", left)
    if _ORDER & set(left.split()):
        return None
    return None if any(verb.plain for verb in find_verbs(left)) else state


def in_state(scene: Scene, name: str, state: State) -> bool:
    """Return whether telemetry shows an asset in `state`."""
    asset = scene.asset(name)
    failed = asset.status == "failed"
    if state == "low":
        return asset.low_battery and not failed
    if state == "failed":
        return failed or not asset.available
    return not failed and (asset.comms == "lost" or asset.stale or asset.integrity == "suspect")


def what_is_due(scene: Scene, names: Iterable[str], state: State) -> str | Unclear:
    """Return the order due for an asset that is reported in `state`.

    `names` are the assets that the words may mean; those that telemetry shows in that state are
    chosen.
    """
    meant = list(names)
    so = [name for name in meant if in_state(scene, name, state)]
    if len(so) > 1 or (not so and len(meant) > 1):
        return Unclear("", "Which one is meant?", tuple(so or meant))
    name = (so or meant)[0]
    asset, gate = scene.asset(name), scene.guarded_by(name)
    if asset.status == "failed":
        state = "failed"
        so = [name]
    others = [guard for guard in scene.guards(gate) if guard != name] if gate else []
    if not so and state != "silent":
        told = f"{name} reports {asset.battery_pct:.0f} % battery and status {asset.status}"
        return Unclear("", f"{told}. What is to be done?", _remedies(name, gate, others))
    if state == "low":
        if gate and not others:
            return f"Relieve {name} at {gate}."
        return f"{name} has a low battery and must return to base."
    if gate and not others:
        if state == "failed":
            return f"{name} has failed: fill the gap at {gate}."
        return f"{name} is silent, so {gate} needs a second guard: send one asset to {gate}."
    why = "has failed" if state == "failed" else "is not heard"
    return Unclear("", f"{name} {why}, and no gate is left without guard. What is to be done?")


def _remedies(name: str, gate: str, others: Iterable[str]) -> tuple[str, ...]:
    if gate and not tuple(others):
        return (f"Relieve {name} at {gate}.", "Nothing, everybody stays.")
    return (f"{name} home.", "Nothing, everybody stays.")
