"""Event journal: one call makes an event of `common.events` with the time of a clock and its source, and hands it on.

    journal = Journal(tell, clock.now_ns)
    journal.child("link").tell("client-joined", client=name)

For the parts of the running daemon. What is pure (`onboard.reading`) is given the time and makes its events itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from common.events import event
from common.messages import Event


@dataclass(frozen=True, slots=True)
class Journal:
    """The place where one part of the daemon reports its events."""

    sink: Callable[[Event], None]
    """Takes every event, in the thread and at the moment of `tell`."""
    now_ns: Callable[[], int]
    """The boat clock, ns; read once for each event."""
    source: str = "daemon"
    """Source of each event: a part (daemon, link, spool), a sensor's id, or who spoke (operator)."""

    def child(self, source: str) -> "Journal":
        """A journal with the same clock and sink for another source."""
        return replace(self, source=source)

    def tell(self, code: str, /, **evidence: str | float | bool | None) -> None:
        """Hand on the event `code` of the table, which happens now; `evidence` fills its text and travels along.

        Raises KeyError for a code that is not in the table, or when its text needs more evidence.
        """
        self.tell_at(self.now_ns(), code, **evidence)

    def tell_at(self, t_ns: int, code: str, /, **evidence: str | float | bool | None) -> None:
        """The same for a caller that has read the clock already, at boat time `t_ns`."""
        self.sink(event(code, t_ns, self.source, **evidence))
