"""The opening of a run: the first operations of a filter, kept so that they can be filtered again once R is known.

A wrong R0 does its harm in the first seconds: the state swallows noise taken for knowledge, P shrinks, and both need
minutes to recover. So the operations since the start are kept, and each time the slowest sensor has doubled its number
of samples (2, 4, 8, 16, 32) all of them are filtered again from the first state, with the R learned so far held.
After that the opening is dropped. In all this costs twice the opening's own time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from shore.navigation.measurements import Known, Measurement, Sailing, Stream
from shore.navigation.models import ImuInput
from shore.navigation.numbers import Array

FIRST_DUE: Final = 2
"""Samples of the slowest sensor at which the opening is filtered again for the first time."""
LAST_DUE: Final = 32
"""... and for the last time."""
MOST_OPERATIONS: Final = 2_000
"""The opening ends here at the latest (a minute of a 20 Hz IMU and a 10 Hz compass, with a sensor gone silent)."""


class Passed(NamedTuple):
    """A prediction."""

    dt_s: float
    imu: ImuInput | None


@dataclass(frozen=True, slots=True)
class Opening:
    """What has happened to a filter since its start; immutable."""

    x: Array
    """First state (..., n)."""
    P: Array
    """Its covariance (..., n, n)."""
    read_from: Mapping[int, str] = field(default_factory=dict)
    """Component -> channel it was read from: its variance holds that channel's R0, and follows when R is learned."""
    operations: tuple[Passed | Measurement | Known, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    """Samples of each sensor."""
    due: int = FIRST_DUE

    @property
    def is_due(self) -> bool:
        """Time to filter again."""
        return min(self.counts.values(), default=0) >= self.due

    @property
    def is_over(self) -> bool:
        """No more to come."""
        return self.due > LAST_DUE or len(self.operations) >= MOST_OPERATIONS

    def then(self, operation: Passed | Measurement | Known) -> "Opening":
        """With one more operation."""
        counts = self.counts
        if not isinstance(operation, Passed | Sailing | Stream):
            counts = {**counts, operation.sensor: counts.get(operation.sensor, 0) + 1}
        return replace(self, operations=(*self.operations, operation), counts=counts)

    def later(self) -> "Opening | None":
        """After it was filtered again."""
        after = replace(self, due=2 * self.due)
        return None if after.is_over else after
