"""Memory of a filter of a real boat (fault-tolerant fusion): what it knows of its sensors; how it acts on the filter.

`Trust` is immutable and lies in the filter's state, so that it is rewound and replayed with it.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from shore.navigation.measurements import Lever, Measurement
from shore.navigation.noise.own_scatter import PRIOR_WEIGHT
from shore.navigation.numbers import Array
from shore.navigation.state_space import HEADING, Gaussian, StateSpace
from shore.navigation.trust.axes import Axes, Axis
from shore.navigation.trust.marks import RunningSums, Turned
from shore.navigation.trust.receiver import Receiver
from shore.navigation.trust.turns import Turns
from shore.navigation.trust.waves import Waves


class Vessel(NamedTuple):
    """What the rules must know of the boat."""

    leeway_m_s: float
    """1-sigma of the speed athwart through the water, m/s; 0 = it goes athwart as it likes."""
    levers: Mapping[str, Lever]
    """Lever arm of each receiver's antenna; absent = at the reference point."""
    has_gyro: bool = True
    """Whether a yaw rate is measured and configured for use."""
    heel_left: float = 1.0
    """Share of the gravity that a heel shows which is left: less where a unit takes it out itself."""


class Way(NamedTuple):
    """How the boat goes and turns."""

    pending_s: float = 0.0
    """Time since the water was last taken into account, s."""
    quiet_s: float = 0.0
    """Time since the last fix, s."""
    blind_s: float = 0.0
    """Time since the inertial unit last measured anything, s."""
    square: float = 0.25
    """Fading mean of the squared difference between speed ahead and way, m^2/s^2."""
    turn_rad_s: float = 0.0
    """Yaw rate: the gyro's less its bias while it is in use, else that of a compass."""
    slow_turn_rad_s: float = 0.0
    """Yaw rate as its fading mean over some ten seconds."""


class Trust(NamedTuple):
    """All that is remembered of the sensors; immutable."""

    first: Gaussian
    """The first state, for the biases when the filter starts once more."""
    started_ns: int | None = None
    """Time of the first measurement; `None` = none yet."""
    is_provisional: bool = True
    """True until the noise of the sensors is known; then the filter starts once more."""
    tally: RunningSums = RunningSums()
    receivers: Mapping[str, Receiver] = {}
    compasses: Mapping[str, Turned] = {}
    axes: Axes = (Axis(), Axis())
    turns: Turns = Turns()
    way: Way = Way()
    waves: Waves = Waves()

    @property
    def verdicts(self) -> tuple[tuple[str, str, int], ...]:
        """(event code, sensor or "", since when) of what is set aside now."""
        found = [("velocity-set-aside", name, since) for name, each in self.receivers.items()
                 if (since := each.wrong_since_ns) is not None]  # fmt: skip
        found += [("compass-set-aside", name, since) for name, since in self.turns.wrong_since_ns.items()]
        if self.turns.gyro_wrong_since_ns is not None:
            found.append(("gyro-set-aside", "", self.turns.gyro_wrong_since_ns))
        return tuple(found)


class Regard(NamedTuple):
    """How one measured scalar is to be fused."""

    claimed: float | None = None
    """Variance that its sensor claims of its white noise, from which its own scatter begins; `None` = as configured."""
    factor: float = 1.0
    """Factor on the variance R that the rule proposes."""
    more: float = 0.0
    """Variance that is added to R."""
    considered: Sequence[int] = ()
    """States that are taken into account and not estimated (Schmidt)."""


class Engine(Protocol):
    """The filter, as far as this module uses it."""

    @property
    def gaussian(self) -> Gaussian:
        """What it believes."""
        ...

    @property
    def trust(self) -> Trust:
        """What it remembers of its sensors."""
        ...

    def remember(self, trust: Trust) -> None:
        """Exchange that."""
        ...

    def scatter_of(self, channel: str) -> tuple[float, float] | None:
        """Own white variance of a channel and the weight of what it was learned from; `None` = nothing measured."""
        ...

    def fuse_parts(self, measured: Measurement, regards: Sequence[Regard]) -> None:
        """Fuse the components of a measurement."""
        ...

    def fuse_known(self, known: Any, *, has_tail: bool = False) -> None:
        """Fuse what has a variance of its own; `has_tail`: a jump has a larger one."""
        ...

    def recast(self, x: Array, F: Array, Q: Array) -> None:
        """Exchange the state: its errors become F errors + noise of covariance Q."""
        ...

    def forget(self, sensor: str) -> None:
        """Forget the noise that was learned of a sensor's channels."""
        ...


def put(engine: Engine, name: str, receiver: Receiver) -> None:
    """Exchange the memory of a receiver."""
    trust = engine.trust
    engine.remember(trust._replace(receivers={**trust.receivers, name: receiver}))


def white_of(engine: Engine, name: str) -> float:
    """White variance of a receiver's fixes on one axis, m^2."""
    found = [engine.scatter_of(f"{name}.{axis}") for axis in ("east", "north")]
    variances = [each[0] * _unsure(each[1]) for each in found if each is not None]
    return sum(variances) / len(variances) if variances else 1.0


def compass_sigma(engine: Engine, name: str) -> float:
    """White 1-sigma of a compass, rad."""
    own = engine.scatter_of(f"{name}.heading")
    return math.sqrt(own[0] * _unsure(own[1])) if own is not None else math.radians(1.0)


def _unsure(weight: float) -> float:
    """Factor on a variance that was learned from few readings, so that it is hardly ever too small."""
    return 1.0 + 6.0 / max(weight - PRIOR_WEIGHT, 1.0)


def error_places(space: StateSpace, receiver: str) -> tuple[int | None, int | None]:
    """Places of the lasting error of a receiver's fixes, east and north; `None` = no such state."""
    return space.index(f"{receiver}_error_east_m"), space.index(f"{receiver}_error_north_m")


def compass_places(space: StateSpace, compass: str) -> tuple[int, ...]:
    """Places of the errors of a compass that are states: bias, sin and cos coefficient."""
    found = (space.index(f"{compass}_{kind}_rad") for kind in ("bias", "sin", "cos"))
    return tuple(place for place in found if place is not None)


def heading_places(space: StateSpace) -> list[int]:
    """The heading and all errors of compasses."""
    kinds = ("_bias_rad", "_sin_rad", "_cos_rad")
    return [HEADING, *(i for i, name in enumerate(space.names) if name.endswith(kinds))]


def renew(engine: Engine, places: Sequence[int], variances: Sequence[float]) -> None:
    """States begin again: mean 0, with these variances."""
    space, x, _ = engine.gaussian
    fresh, F, Q = x.copy(), np.eye(space.size), np.zeros((space.size, space.size))
    for place, variance in zip(places, variances, strict=True):
        fresh[place], F[place], Q[place, place] = 0.0, 0.0, variance
    if places:
        engine.recast(fresh, F, Q)


def to_prior(engine: Engine, first: Gaussian, places: Sequence[int]) -> None:
    """States begin again as at the first start."""
    renew(engine, places, [float(first.P[place, place]) for place in places])
