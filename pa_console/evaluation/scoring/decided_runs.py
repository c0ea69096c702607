"""The point from which the score of a run cannot change, so that the rest need not be watched."""

from pa_console.evaluation.scoring.run_recording import STAYING, RunRecording
from pa_console.evaluation.scoring.success_conditions import asked_fields
from pa_console.schema.evaluation import MissionCase

FROM_ORDERS = frozenset(
    (
        "command", "status", "refused", "actions", "reports", "moved", "broken", "start",
        "grace_s", "standoff_m", "gates", "base",
    )
)  # fmt: skip
"""Success conditions that depend on the command, the orders and their answers alone, if no order
has sent an asset anywhere."""


def is_decided(case: MissionCase, recording: RunRecording) -> bool:
    """Return whether the score of a run of `case` stands; its mission is over.

    It does where nothing was ordered but to hold and to report, every order was answered, and the
    conditions ask for nothing but what follows from that. Nobody can be moved by an order then, and
    a rule is broken by orders alone (see oracle.py).
    """
    answered = all(o.verb in STAYING and (o.done or o.rejected) for o in recording.orders)
    return answered and all(asked_fields(source) <= FROM_ORDERS for source in case.success)
