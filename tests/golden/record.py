"""Rewrites the golden data: `python -m tests.golden.record [PART ...]`, by default all parts.

`python -m tests.golden.record show MISSION [NAME]` prints a text that a model is given, as it is
now. Outcomes take minutes and the default model; they are recorded only when they are named.
"""

import sys

from tests.golden import (
    test_command_line,
    test_outcomes,
    test_prompts,
    test_session_logs,
    test_state_hash,
)

PARTS = {
    "prompts": test_prompts.record,
    "state_hash": test_state_hash.record,
    "command_line": test_command_line.record,
    "session_logs": test_session_logs.record,
    "outcomes": test_outcomes.record,
}
LONG = ("outcomes",)


def main(words: list[str]) -> None:
    """Record the parts that are named."""
    if words[:1] == ["show"]:
        print(test_prompts.show(*words[1:3]))
        return
    for part in words or [name for name in PARTS if name not in LONG]:
        PARTS[part]()
        print(f"recorded {part}")


if __name__ == "__main__":
    main(sys.argv[1:])
