"""Authorizations, with which a vehicle verifies that named people approved a command.

People sign approvals. A station signs a token for each command and includes the approvals. The
`Verifier` of the vehicle checks both against the roster, which the site's owner has signed.

This folder depends only on pyjwt, cryptography and the standard library, not on other parts of
`pa_console`, so that a vehicle can use it alone.
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
