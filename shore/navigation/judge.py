"""A judge of sensors: fault detection and exclusion at the outlier gate of each scalar update. Judges live elsewhere.

A filter asks before each update by what a sensor measured, and before its noise rule learns from it. The judge is an
immutable value and lies in `FilterState`: what it knows is rewound, replayed and filtered again with the state, so its
verdicts are those of the order of time, whatever the order of arrival. What it found is the difference between the
judges of two states; it must not be reported while it judges, for a rewind may take a verdict back.
"""

from typing import NamedTuple, Protocol

from shore.navigation.numbers import Number
from shore.navigation.state_space import Gaussian


class Evidence(NamedTuple):
    """What a filter knows of one measured scalar before it is fused."""

    t_ns: int
    """Boat time of the measurement."""
    channel: str
    """Channel of the scalar: `gps1.east`, `compass1.heading`, ..."""
    innovation: Number
    """Innovation: measured - expected, m or rad; an angle is wrapped."""
    prior_variance: Number
    """Variance h P h^T of the expected number, m^2 or rad^2."""
    variance: Number
    """R in use, m^2 or rad^2, not yet adapted to this innovation, whose variance is S = prior_variance + variance."""
    state: Gaussian
    """State of the filter before the update; of a fix, north is judged with the state into which east is fused."""


class Verdict(NamedTuple):
    """What a judge says of one scalar."""

    judge: "Judge"
    """The judge that has heard this evidence too."""
    scale: Number | None
    """Factor > 0 on the R of this update alone, 1 = as it is; `None` = rejected: state and R stay as they were."""


class Judge(Protocol):
    """One for each filter; immutable."""

    def hear(self, evidence: Evidence) -> Verdict:
        """Judge one scalar; evidence comes in order of time."""
        ...
