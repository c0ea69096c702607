"""What the frame of the approval panel says of the next key, where the focus alone does not."""

from typing import Literal

FocusAt = Literal["panel", "reading", "approve", "within", "elsewhere"]
"""Where the keys go: the panel itself, a reading that is shown, Approve, another of its fields."""


def next_key(focus: FocusAt, *, joined: bool, plays: bool) -> str:
    """Return what the next key does, '' where that is plain to see.

    `joined` says that a plan is signed here for another station, `plays` that there is a rehearsal
    to be played.
    """
    match focus:
        case "panel":
            return "a goes to Countersign" if joined else "r, m or a goes to a button"
        case "reading":
            return "Enter reads the order so, Esc goes back to the plan"
        case "approve":
            return "Enter signs it" if joined else "Enter approves, r goes back to Reject"
        case "within":
            return "Space plays it, Alt+C compares plans" if plays else ""
        case "elsewhere":
            return ""
