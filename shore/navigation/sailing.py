"""No-sideslip constraint: a boat goes through the water where its bow points, with the way that its thrust keeps up."""

from typing import NamedTuple

from shore.navigation.measurements import PseudoPart, PseudoScalar
from shore.navigation.motion_model import through_water
from shore.navigation.numbers import Array, part
from shore.navigation.state_space import StateSpace


class Sailing(NamedTuple):
    """A boat goes through the water where its bow points, with the way it has."""

    athwart: float
    """Variance of its speed athwart, m^2/s^2."""
    along: float
    """Variance of its speed ahead about its way, m^2/s^2."""

    @property
    def parts(self) -> tuple[PseudoPart, ...]:
        """No speed athwart; speed ahead = the way, where that is a state."""
        return self._no_speed_athwart, self._speed_is_way

    def _no_speed_athwart(self, space: StateSpace, x: Array) -> PseudoScalar:
        _, (speed, slope) = through_water(space, x)
        return PseudoScalar(x, tuple(slope.items()), -speed, self.athwart)

    def _speed_is_way(self, space: StateSpace, x: Array) -> PseudoScalar | None:
        if (way := space.index("way_m_s")) is None:
            return None
        (speed, slope), _ = through_water(space, x)
        return PseudoScalar(x, (*slope.items(), (way, -1.0)), part(x, way) - speed, self.along)
