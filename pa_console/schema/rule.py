"""Operational policy as data: rules with their checks and examples, and the seals of rule sets."""

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, StringConstraints, model_validator

from pa_console.schema.base import Hex32, Hex64, Positive, StrictModel
from pa_console.schema.command import COMMANDS, STILL, Verb

Domain = Literal["ROE", "WF", "CAP"]
Priority = Literal["critical", "high", "medium"]
PRIORITIES: tuple[Priority, ...] = ("critical", "high", "medium")
PLACEHOLDER = re.compile(r"\{(track|gate)\}")
"""A placeholder in the mission of a workflow's phase."""
Version = Annotated[str, StringConstraints(pattern=r"^([A-Za-z0-9][A-Za-z0-9._+-]{0,31})?$")]
"""The version of a rule set; empty for none. In YAML, a version like a number needs quotes."""

MOST_PEOPLE = 9

ACTS = (
    *(verb for verb in COMMANDS if verb not in STILL),
    "override",
    "acknowledge",
    "first_order",
)
"""The acts that may need more than one person: each command that moves an asset, overriding the
judge, acknowledging a broken rule of Medium priority, and the first order to a vehicle."""

SHORT = 12


class RuleExample(StrictModel):
    """A small plan and state that must pass or fail the rule's check.

    `plan` has pairs of agent and command, and `given` overrides parts of the default state. With
    `moments`, the example is for the rule's orderings instead. `policy/authoring/examples.py`
    describes both notations.
    """

    name: str
    expect: Literal["pass", "fail", "not_applicable"]
    mission: str = ""
    reason: str = "example"
    plan: tuple[tuple[str, str], ...] = Field(default=(), description="(agent, command) pairs")
    given: dict[str, Any] = {}
    moments: tuple[dict[str, Any], ...] = Field(
        default=(), description="the changes from one moment to the next"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.moments and (self.plan or self.given or self.mission):
            raise ValueError(
                "moments: an example has either moments, or a plan with mission and given"
            )
        if self.moments and self.expect == "not_applicable":
            raise ValueError("expect: an example with moments must expect pass or fail")
        return self


class Ordering(StrictModel):
    """A required order of events in a mission; `event` and `other` are CEL over a moment.

    With `each`, `it` is bound to every track or gate in turn, and `id` to its name. Each track or
    gate is followed separately, from the moment at which it first appears.

    before       `event` may first hold only at or after a moment at which `other` has held
    after        once `other` has held, `event` must hold at some moment before the mission ends
    never_while  `event` must not hold at a moment at which `other` holds
    within       once `other` begins to hold, `event` must hold within `seconds`, unless `other`
                 ends first
    until        `event` must hold at every moment until `other` first holds
    """

    kind: Literal["before", "after", "never_while", "within", "until"]
    event: str
    other: str
    each: Literal["track", "gate"] | None = None
    seconds: Positive | str | None = Field(
        default=None, description="a number, or CEL over the world that yields a number"
    )
    message: str = Field(
        min_length=1, description="the problem in words; the subjects are appended"
    )

    @model_validator(mode="after")
    def _seconds_fit(self) -> Self:
        if (self.kind == "within") != (self.seconds is not None):
            raise ValueError("seconds is required for kind 'within', and for no other kind")
        return self


class Rule(StrictModel):
    """One rule; if it has neither `check` nor `order`, only the LLM judges it."""

    id: str = Field(pattern=r"^[A-Z]+-\d{2,}$")
    domain: Domain
    priority: Priority
    text: str = Field(min_length=1)
    tags: tuple[str, ...] = ()
    applies: str | None = Field(
        default=None,
        description="CEL that decides whether the rule applies; if absent, it always does",
    )
    check: str | None = Field(
        default=None,
        description="CEL that yields true, or an empty list of offenders, if the rule is kept",
    )
    message: str = Field(default="", description="the problem in words; the offenders are appended")
    order: tuple[Ordering, ...] = ()
    examples: tuple[RuleExample, ...] = ()
    in_prompts: bool = Field(
        default=True,
        exclude_if=lambda shown: shown,
        description="false if no model sees the rule, and only software enforces it",
    )

    @property
    def decidable(self) -> bool:
        """True if software can decide the rule, completely or in part."""
        return self.check is not None or bool(self.order)

    @property
    def enforced(self) -> bool:
        """True if a violation always blocks the plan (critical or high, and decidable)."""
        return self.decidable and self.priority in ("critical", "high")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.id.startswith(self.domain + "-"):
            raise ValueError(f"id {self.id!r} does not start with its domain {self.domain!r}")
        if not self.in_prompts and not self.enforced:
            raise ValueError(
                "in_prompts: only a critical or high rule with check or order may be hidden from "
                "the models; remove the field, or add a check or order"
            )
        if self.check is None and (self.applies or self.message):
            raise ValueError("applies and message need a check")
        if any(self.check is None and not example.moments for example in self.examples):
            raise ValueError("an example with a plan needs a check")
        if any(not self.order and example.moments for example in self.examples):
            raise ValueError("an example with moments needs an order")
        if self.check is not None and not self.message:
            raise ValueError("a rule with a check needs a message that says what is wrong")
        return self


def _only_placeholders(command: str) -> str:
    """Refuse braces other than plain placeholders, so that there is no format expression."""
    rest = PLACEHOLDER.sub("", command)
    if "{" in rest or "}" in rest:
        begun = re.search(r"\{[^}]{0,20}\}?|\}", rest)
        raise ValueError(
            "only {track} and {gate} are allowed in braces; change or remove "
            f"{begun[0] if begun is not None else rest[:20]!r}"
        )
    return command


class Phase(StrictModel):
    """One phase of a workflow, which is planned, checked, judged and approved separately.

    `when` and `done` are CEL over a moment, with `it` bound to the workflow's track. A phase is
    over if `done` holds; otherwise it is skipped if `when` does not hold. If `verbs` are given, the
    planner can use only these commands. Only checks and judge limit the plan further.
    """

    name: str
    command: Annotated[str, AfterValidator(_only_placeholders)] = Field(
        min_length=1, description="the mission of the phase, with placeholders {track} and {gate}"
    )
    verbs: tuple[Verb, ...] = ()
    when: str = "true"
    done: str

    def mission(self, track: str, gate: str) -> str:
        """Return the command with `track` and `gate` in place of the placeholders."""
        return PLACEHOLDER.sub(lambda match: track if match[1] == "track" else gate, self.command)


class Workflow(StrictModel):
    """A sequence of phases over several plans that a rule prescribes (WF-01).

    `starts` is CEL over a moment, with `it` bound to a track at one of the mission's gates. `ends`
    maps outcomes to the same kind of CEL. If one of them holds, the workflow ends with this
    outcome, early or after its last phase.
    """

    id: str = Field(pattern=r"^[a-z][a-z0-9-]*$")
    rule: str
    starts: str
    ends: dict[str, str] = Field(default={}, description="outcome in words -> its condition in CEL")
    gone: str = Field(default="gone", description="outcome if the track is no longer known")
    phases: tuple[Phase, ...] = Field(min_length=1)


def _people(approvals: dict[str, int]) -> dict[str, int]:
    """Refuse unknown acts and invalid numbers of people.

    Also refuse `hold` and `report`, which never wait for a second person.
    """
    for act, people in approvals.items():
        if act in STILL:
            raise ValueError(
                f"{act!r} moves no asset and never waits for a second person; remove it"
            )
        if act not in ACTS:
            raise ValueError(f"{act!r} is not an act that people approve; known: {', '.join(ACTS)}")
        if not 1 <= people <= MOST_PEOPLE:
            raise ValueError(f"{act}: {people} people; give a number from 1 to {MOST_PEOPLE}")
    return approvals


def approvals_in_words(approvals: Mapping[str, int]) -> str:
    """Return the acts that need several people, e.g. `block 2, override 2`; '' without any."""
    return ", ".join(f"{act} {people}" for act, people in approvals.items() if people > 1)


class StandingLimits(StrictModel):
    """The limits of standing orders, which by default need approval for every plan.

    If a standing order states that no approval is needed, a plan of its missions is carried out
    without approval if every command in it that moves an asset is `allowed`.
    """

    allowed: tuple[Verb, ...] = Field(
        default=(), description="commands that may be given without approval"
    )


class RuleSet(StrictModel):
    """A rule file: the rules, and the workflows that they prescribe.

    `approvals` maps acts to the number of people who must approve them. `standing` limits what
    standing orders may do without approval.
    """

    name: str
    version: Version = ""
    source: str = ""
    approvals: Annotated[dict[str, int], AfterValidator(_people)] = Field(
        default={}, description="act -> number of people who must approve it, if more than one"
    )
    standing: StandingLimits = Field(
        default_factory=StandingLimits,
        exclude_if=lambda limits: not limits.allowed,
        description="what standing orders may do without approval",
    )
    rules: tuple[Rule, ...] = Field(min_length=1)
    workflows: tuple[Workflow, ...] = ()

    @model_validator(mode="after")
    def _workflows_have_rules(self) -> Self:
        ids = {rule.id for rule in self.rules}
        for workflow in self.workflows:
            if workflow.rule not in ids:
                raise ValueError(f"workflow {workflow.id!r}: there is no rule {workflow.rule!r}")
        return self


class RuleHit(StrictModel):
    """One retrieved rule with its score and the parts of the score."""

    rule_id: str
    score: float
    components: dict[str, float] = {}
    pinned: bool = False


Standing = Literal["shipped", "own key", "known key", "unknown key", "not signed", "altered"]

_WORDS: dict[Standing, str] = {
    "shipped": "as shipped",
    "own key": "signed by this machine's key",
    "known key": "signed by a known key",
    "unknown key": "signed by an unknown key",
    "not signed": "not signed",
    "altered": "ALTERED since it was signed",
}


class RulesSeal(StrictModel):
    """A rule set's version, the hash of its content, and its standing.

    `key` is the fingerprint of the key that made an intact signature, and `signer` the name of that
    key among the known keys. `problem` describes what was altered. `accepted` is the reason why the
    operator had to accept the set, or '' if it was accepted automatically. `core` is the hash of
    the core that is also in force, or ''. If `no_critical_check` is true, the set has no critical
    rule of its own that software decides.
    """

    version: Version = ""
    content_sha256: str = ""
    standing: Standing = "not signed"
    key: str = ""
    signer: str = ""
    problem: str = ""
    accepted: str = ""
    core: str = ""
    no_critical_check: bool = False

    @property
    def altered(self) -> bool:
        """True if the set was signed and has changed since then."""
        return self.standing == "altered"

    @property
    def words(self) -> str:
        """The standing in plain words."""
        return _WORDS[self.standing] + (f" ({self.signer})" if self.signer else "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings about the set, which are shown with it in red."""
        lines: list[str] = []
        if self.accepted:
            lines.append(f"accepted by the operator although: {self.accepted}")
        if self.no_critical_check:
            lines.append("no critical rule of this set is checked by software")
        return tuple(lines)

    @property
    def title(self) -> str:
        """The version, if the set has one, and the beginning of the hash."""
        version = f"version {self.version}" if self.version else ""
        return f"{version} {self.content_sha256[:SHORT]}".strip()


class RulesSignature(StrictModel):
    """A signature file: the signed facts, with the public key and the signature in hexadecimal."""

    name: str
    version: Version
    content_sha256: Hex32
    key: Hex32
    signature: Hex64
