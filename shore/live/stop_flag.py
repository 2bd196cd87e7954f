"""Stop flag (signal handling): Ctrl-C and SIGTERM end a live run between two frames, so that its log is closed."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


class StopFlag:
    """Set by Ctrl-C and SIGTERM; asked between frames, so that the log is always closed."""

    def __init__(self) -> None:
        self.reason: str | None = None

    def __call__(self) -> bool:
        """True once a signal came."""
        return self.reason is not None

    @contextmanager
    def on_signals(self) -> Iterator["StopFlag"]:
        """Catch SIGINT, SIGTERM and a closed terminal (SIGHUP) inside the block."""
        handled = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        previous = {number: signal.signal(number, self._catch) for number in handled}
        try:
            yield self
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _catch(self, number: int, _frame: object) -> None:
        self.reason = signal.Signals(number).name
