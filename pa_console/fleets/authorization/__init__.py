"""Authorizations: proof, at the vehicle, that named people have approved this very command.

People sign approvals, a station signs a token for each command with the approvals in it, and the
`Verifier` of a vehicle checks both against the roster that the owner of the site has signed. This
folder needs pyjwt, cryptography and the standard library and no other part of this package.
"""

from pa_console.fleets.authorization.messages import (
    APPROVAL_S,
    UNSIGNED,
    Approval,
    Command,
    EnrolledRules,
    Grounds,
    Kind,
    Person,
    Records,
    RefusedError,
    Role,
    Roster,
    UnsignedApproval,
    digest,
    public_of,
    sign_approval,
    sign_command,
    sign_records,
    sign_revocation,
    sign_roster,
    sign_takeover,
    words,
)
from pa_console.fleets.authorization.trust import KINDS_OF_TRUST, SignedMessages, Takeover, Trust
from pa_console.fleets.authorization.verifier import Memory, Verifier

__all__ = (
    "APPROVAL_S",
    "KINDS_OF_TRUST",
    "UNSIGNED",
    "Approval",
    "Command",
    "EnrolledRules",
    "Grounds",
    "Kind",
    "Memory",
    "Person",
    "Records",
    "RefusedError",
    "Role",
    "Roster",
    "SignedMessages",
    "Takeover",
    "Trust",
    "UnsignedApproval",
    "Verifier",
    "digest",
    "public_of",
    "sign_approval",
    "sign_command",
    "sign_records",
    "sign_revocation",
    "sign_roster",
    "sign_takeover",
    "words",
)
