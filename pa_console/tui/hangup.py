"""Notices that the terminal is gone, also where no signal tells of it."""

import select
from collections.abc import Callable
from threading import Thread


def when_hung_up(terminal: int, do: Callable[[], None]) -> None:
    """Call `do` from a thread of its own once nobody is at the other end of the file `terminal`.

    SIGHUP comes from a controlling terminal only. What is typed meanwhile is left to others.
    """
    watch = select.poll()
    watch.register(terminal, 0)  # hang-ups and errors are told whatever is asked for

    def wait() -> None:
        watch.poll()
        do()

    Thread(target=wait, name="hangup", daemon=True).start()
