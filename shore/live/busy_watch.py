"""Deadman switch (watchdog timer) of the picture: a thread that speaks when the run itself stands still.

The run prints the status line. Where it is held up (a disk that hangs, a filter that takes long), the last line would
stand there as if it were of now.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Final

from common.clock import boottime_ns
from common.units import NS_PER_S
from shore.watchers.newest import MOST_OVERDUE_S

LOOK_S: Final = 0.5
"""Interval of its looks, s."""


class BusyWatch:
    """`beat` it in each turn of the run."""

    def __init__(self, say: Callable[[str], None], now_ns: Callable[[], int] = boottime_ns) -> None:
        self._say, self._now_ns = say, now_ns
        self._is_over = Event()
        self.beat()

    def beat(self) -> None:
        """The run goes on."""
        self._beat_ns = self._now_ns()
        self._due_s = MOST_OVERDUE_S

    def look(self) -> None:
        """Say it, once a second, when the run stands still."""
        busy_s = (self._now_ns() - self._beat_ns) / NS_PER_S
        if busy_s >= self._due_s:
            self._due_s = busy_s + 1.0
            self._say(f"STALE: this station has been held up for {busy_s:.0f} s, what it shows is of before")

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Look in a thread of its own inside the block."""
        thread = Thread(target=self._watch, name="busy-watch", daemon=True)
        self.beat()
        thread.start()
        try:
            yield
        finally:
            self._is_over.set()
            thread.join(LOOK_S)  # not for ever: a terminal may hold it up

    def _watch(self) -> None:
        while not self._is_over.wait(LOOK_S):
            self.look()
