"""Score watchers: RMS errors against a reference track, and the consistency of each filter (NIS, NEES)."""

from pathlib import Path

from shore.logbook.estimate_rounding import logged
from shore.report.own_doubt import OwnDoubt
from shore.report.reference import UtcOffset, read_reference
from shore.report.score import Consistency, Score
from shore.watchers.watcher import Step, Watcher


class ScoreWatcher(Watcher):
    """Raw sensors and every filter against a reference track."""

    def __init__(self, reference: Path, utc_offset: UtcOffset = lambda: None) -> None:
        """utc_offset: UTC less boat time of the log, for a reference that counts in UTC."""
        self.score: Score | None = None
        """The score; `None` before the first step, whose frame gives the time at which the reference begins."""
        self._reference = reference
        self._utc_offset = utc_offset

    def take(self, step: Step) -> None:
        """Take a step. Raises WayfixError at the first one when the reference cannot be read."""
        if self.score is None:
            self.score = Score(read_reference(self._reference, step.frame.t0_ns, self._utc_offset), step.start.config)
        self.score.take_frame(step.frame)
        for record in step.records:
            self.score.take_estimate(logged(record))  # as a log's own estimates are scored, to the last digit


class ConsistencyWatcher(Watcher):
    """Compares the covariance of every filter with its innovations."""

    def __init__(self) -> None:
        self.consistency = Consistency()

    def take(self, step: Step) -> None:
        """Take every estimate of the step."""
        for record in step.records:
            self.consistency.take(record)


class DoubtWatcher(Watcher):
    """Keeps what a filter stated, to be held against the smoothed track."""

    def __init__(self, name: str) -> None:
        """name: of the filter."""
        self.doubt = OwnDoubt(name)

    def take(self, step: Step) -> None:
        """Take every estimate of the step."""
        for record in step.records:
            self.doubt.take(record)
