"""Repeated initialisation: the first operations of a filter are kept and filtered again once their noise R is known.

A wrong R0 does its harm in the first seconds: the state swallows noise taken for knowledge, P shrinks, and both need
minutes to recover. So the operations since the start are kept, and each time the slowest sensor has doubled its number
of samples (2, 4, 8, 16, 32) all of them are filtered again from the first state, with the R learned so far held.
After that the opening is dropped. In all this costs twice the opening's own time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from shore.navigation.measurements import Measurement, PseudoMeasurement
from shore.navigation.motion_model import ImuInput
from shore.navigation.numbers import Array

FIRST_DUE: Final = 2
"""Samples of the slowest sensor at which the opening is filtered again for the first time."""
LAST_DUE: Final = 32
"""Samples of the slowest sensor at which it is filtered again for the last time."""
MOST_OPERATIONS: Final = 8_000
"""The opening ends here at the latest: four minutes of a 20 Hz IMU and a 10 Hz compass."""
SILENT_AFTER: Final = 3.0
"""Mean intervals without a sample after which a sensor is not waited for."""


class Passed(NamedTuple):
    """A prediction, as an operation."""

    dt_s: float
    imu: ImuInput | None


class Assumed(NamedTuple):
    """A pseudo-measurement, as an operation."""

    known: PseudoMeasurement


Operation = Passed | Assumed | Measurement
"""What is done to a filter."""


@dataclass(frozen=True, slots=True)
class Opening:
    """What has happened to a filter since its start; immutable."""

    x: Array
    """Mean of the first state, (..., n)."""
    P: Array
    """Covariance of the first state, (..., n, n)."""
    read_from: Mapping[int, str] = field(default_factory=dict)
    """Component -> channel it was read from: its variance holds that channel's R0, and follows when R is learned."""
    operations: tuple[Operation, ...] = ()
    """All operations since the start, in order."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Number of samples of each sensor since the start."""
    heard: Mapping[str, int] = field(default_factory=dict)
    """Number of operations since the start up to the last sample of each sensor."""
    due: int = FIRST_DUE
    """Samples of the slowest sensor at which it is filtered again next."""

    @classmethod
    def at(cls, x: Array, P: Array, read_from: Mapping[int, str]) -> "Opening":
        """Opening at a start; the sensors it was read from are waited for."""
        return cls(x, P, read_from, counts={channel.rpartition(".")[0]: 0 for channel in read_from.values()})

    @property
    def is_due(self) -> bool:
        """True when it is time to filter again."""
        waited_for = (count for sensor, count in self.counts.items() if not self._is_silent(sensor))
        return min(waited_for, default=0) >= self.due

    def _is_silent(self, sensor: str) -> bool:
        count, heard = self.counts[sensor], self.heard.get(sensor, 0)
        patience = SILENT_AFTER * heard / count if count > 1 else MOST_OPERATIONS / 4
        return len(self.operations) - heard > patience

    @property
    def is_over(self) -> bool:
        """True when it is filtered again no more."""
        return self.due > LAST_DUE or len(self.operations) >= MOST_OPERATIONS

    def then(self, operation: Operation) -> "Opening":
        """The opening with one more operation."""
        operations = (*self.operations, operation)
        if isinstance(operation, Passed | Assumed):
            return replace(self, operations=operations)
        sensor = operation.sensor
        counts = {**self.counts, sensor: self.counts.get(sensor, 0) + 1}
        return replace(self, operations=operations, counts=counts, heard={**self.heard, sensor: len(operations)})

    def later(self) -> "Opening | None":
        """After it was filtered again."""
        after = replace(self, due=2 * self.due)
        return None if after.is_over else after
