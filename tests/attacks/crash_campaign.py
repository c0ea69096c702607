"""`python -m tests.attacks.crash_campaign --kills 1000`: processes killed between any two lines.

Sessions, and changes of a site's keys, are killed by SIGKILL at random lines of what logs, signs
and sends, and go on in a new process. A fifth of the sessions lose the unwritten part of their
files too, as when power fails.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from tests.attacks.crash_lines import instrument

MODULES = (
    "pa_console.private_files",
    "pa_console.signing",
    "pa_console.session.log.chain",
    "pa_console.session.log.writer",
    "pa_console.session.log.session_index",
    "pa_console.session.log.signed_head",
    "pa_console.mission.gate",
    "pa_console.session.log.writer",
    "pa_console.mission.execute",
    "pa_console.mission.decide",
    "pa_console.mission.stop",
    "pa_console.fleets.key_folder",
)
"""The modules between an event and a command, and those that write keys."""


def main() -> None:
    """Run the trials and print what they found; the exit code is 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=1000, help="trials; a quarter changes keys")
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    given = parser.parse_args()
    instrument(MODULES)
    # Imported only now, so that their lines are counted.
    from tests.attacks.crash_trial import (  # noqa: PLC0415
        Found,
        KeysTrial,
        SessionTrial,
        checkpoint,
        counted,
    )

    checkpoint()
    began = time.process_time()
    sessions, keys = Found(), Found()
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name)
        in_session = counted(SessionTrial(whole / "counted", given.seed).live)
        in_keys = counted(KeysTrial(whole / "counted", given.seed).live)
        for seed in range(given.seed, given.seed + given.kills):
            folder = whole / str(seed)
            folder.mkdir()
            if seed % 4 == 0:
                keys.add(KeysTrial(folder, seed).run(in_keys))
            else:
                trial = SessionTrial(folder, seed, power=seed % 5 == 0)
                sessions.add(trial.run(in_session))
    print(f"sessions: {sessions.summary()}; {len(in_session)} lines can be reached")
    print(f"keys: {keys.summary()}; {len(in_keys)} lines can be reached")
    print(f"seeds {given.seed} to {given.seed + given.kills - 1}")
    print(*sessions.problems, *keys.problems, sep="\n")
    print(f"own processor time: {time.process_time() - began:.0f} s", file=sys.stderr)
    sys.exit(bool(sessions.problems or keys.problems))


if __name__ == "__main__":
    main()
