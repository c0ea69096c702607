"""A second person signs the plan that waits, with an own key that this machine never sees."""

from collections.abc import Iterable

from pa_console.fleets.authorization import RefusedError, UnsignedApproval
from pa_console.fleets.fleet import Countersigned
from pa_console.fleets.station_authority import StationAuthority
from pa_console.http.problems import ProblemError
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.schema.mission import Decision


class Countersigning:
    """Prepares what a second person signs of a plan, and takes that signature in."""

    def __init__(self, authority: StationAuthority | None) -> None:
        """`authority` has the keys of the station, None where its site has none."""
        self._authority = authority

    def to_sign(self, request: ApprovalRequested, rules: Rulebook, person: str) -> UnsignedApproval:
        """Return what `person` is to sign of `request`; raises ProblemError for nothing."""
        authority = self._keys_for(request)
        try:
            authority.trust.approver(person)
        except RefusedError as refused:
            raise _refused(403, "may-not-sign", str(refused), "person") from refused
        return authority.to_sign(request, rules, person)

    def take(
        self,
        request: ApprovalRequested,
        rules: Rulebook,
        given: Countersigned,
        made: Iterable[DecisionMade],
    ) -> None:
        """Take in what a person has `given` for `request`; raises ProblemError if it is no more.

        `made` are the decisions of its mission so far.
        """
        authority, person = self._keys_for(request), given.person
        if why := authority.objection_to_signature(request, rules, person, given.signature):
            raise _refused(403, "signature-refused", why, "signed")
        if person == authority.person:
            raise ProblemError(
                409, "decides-here", f"{person} sits at this station and decides there",
                field="person", remedy="POST /v1/decisions",
            )  # fmt: skip
        before = _signatures(request, made)
        both = Decision(kind="approve", signatures={**before, person: given.signature})
        if person in before or person not in authority.valid(request, both, rules):
            raise ProblemError(
                409, "signed-already", f"this plan has the signature with the key of {person}",
                field="person", remedy="let somebody else sign",
            )  # fmt: skip

    def _keys_for(self, request: ApprovalRequested) -> StationAuthority:
        """Return the keys of the station if `request` is for others to sign, too."""
        if self._authority is None:
            raise ProblemError(
                409, "no-keys", "this site has no keys, so nobody can be the second person",
                remedy="pa-console keys make",
            )  # fmt: skip
        if request.blocked_by:
            raise ProblemError(409, "not-admissible", "; ".join(request.blocked_by))
        if not request.approvals:
            raise ProblemError(
                409, "one-is-enough", f"one person is enough, who is {self._authority.person}",
                remedy="POST /v1/decisions",
            )  # fmt: skip
        return self._authority


def _signatures(request: ApprovalRequested, made: Iterable[DecisionMade]) -> dict[str, str]:
    """Return what has been signed of `request` so far, by name."""
    now = [each.decision for each in made if each.attempt == request.attempt]
    return {name: text for decision in now for name, text in decision.signatures.items()}


def _refused(status: int, kind: str, why: str, field: str) -> ProblemError:
    return ProblemError(status, kind, why, field=field, remedy="pa-console keys list says who may")
