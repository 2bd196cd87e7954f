"""Progress bar of a replay on a terminal's stderr, as a watcher."""

from datetime import timedelta
from types import TracebackType
from typing import Final, Self

from rich.console import Console
from rich.progress import Progress as Bar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

from shore.watchers.watcher import Step, Watcher

SHOWN_EACH: Final = 50
"""Number of frames between two movements of the bar."""


class Progress(Watcher):
    """A line that says which second of the trip is being replayed. It goes when the block ends."""

    def __init__(self, what: str) -> None:
        """what: the word in front of the bar."""
        columns = (SpinnerColumn(), TextColumn(what), TextColumn("{task.fields[at]}"), TimeElapsedColumn())
        self._bar = Bar(*columns, console=Console(stderr=True), transient=True)
        self._job = self._bar.add_task(what, total=None, at="")
        self._count = 0

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def take(self, step: Step) -> None:
        """Count one more frame."""
        self._count += 1
        if self._count % SHOWN_EACH == 0:
            self._bar.update(self._job, at=f"{timedelta(seconds=int(step.t_s))} of the trip")
