"""Scores of estimates against the truth: RMS error, consistency (NEES inside its 95 % bound), error over own sigma."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from common.geodesy import LocalPlane
from common.simulation.motion import Truth
from common.simulation.without_ports import START_NS
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.navigation.state_space import EAST, HEADING, NORTH, V_EAST, V_NORTH
from shore.report.own_doubt import CHI2_95_2D

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
SETTLED_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over the scored estimates of one filter on one boat; they add up over boats."""

    count: float = 0.0
    inside: float = 0.0
    """Number of estimates whose ellipse holds the truth."""
    position: float = 0.0
    """Squared horizontal error, m^2."""
    position_shown: float = 0.0
    velocity: float = 0.0
    velocity_shown: float = 0.0
    heading: float = 0.0
    """Squared error, deg^2."""
    heading_shown: float = 0.0
    raw: float = 0.0
    """Squared horizontal error of the fixes, m^2."""
    fixes: float = 0.0

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(*(getattr(self, item.name) + getattr(other, item.name) for item in fields(Sums)))

    def figures(self) -> dict[str, float]:
        """RMS, share inside the ellipse, and error over own sigma; NaN where there is no estimate (or no fix)."""
        count = self.count or math.nan

        def to_sigma(square: float, shown: float) -> float:
            return math.sqrt(square / shown) if shown else math.nan

        return {
            "raw_m": math.sqrt(self.raw / (self.fixes or math.nan)),
            "position_m": math.sqrt(self.position / count),
            "in95": self.inside / count,
            "position_e_s": to_sigma(self.position, self.position_shown),
            "velocity_m_s": math.sqrt(self.velocity / count),
            "velocity_e_s": to_sigma(self.velocity, self.velocity_shown),
            "heading_deg": math.sqrt(self.heading / count),
            "heading_e_s": to_sigma(self.heading, self.heading_shown),
        }


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of n estimates, estimate less truth, and what the filter says of them."""

    t_s: Array
    """Time since the start of the voyage, s, (n,)."""
    position_m: Array
    """East and north, (n, 2)."""
    position_covariance: Array
    """(n, 2, 2), m^2."""
    velocity_m_s: Array
    """East and north, (n, 2)."""
    velocity_variance: Array
    """Sum over both axes, (n,), (m/s)^2."""
    heading_deg: Array
    """Wrapped, (n,)."""
    heading_variance: Array
    """(n,), deg^2."""

    def distances(self) -> Array:
        """Squared Mahalanobis distance of the position (NEES of two states), (n,)."""
        inverse = np.linalg.inv(self.position_covariance)
        squares: Array = np.einsum("ki,kij,kj->k", self.position_m, inverse, self.position_m)
        return squares

    def sums(self, keep: Mask, raw: tuple[float, float] = (0.0, 0.0)) -> Sums:
        """Sums over the estimates of a mask (n,); `raw` = squared error of the fixes, m^2, and their number."""
        covariance = self.position_covariance[keep]
        return Sums(
            count=float(np.count_nonzero(keep)),
            inside=float(np.sum(self.distances()[keep] <= CHI2_95_2D)),
            position=float(np.sum(self.position_m[keep] ** 2)),
            position_shown=float(np.sum(covariance[:, 0, 0] + covariance[:, 1, 1])),
            velocity=float(np.sum(self.velocity_m_s[keep] ** 2)),
            velocity_shown=float(np.sum(self.velocity_variance[keep])),
            heading=float(np.sum(self.heading_deg[keep] ** 2)),
            heading_shown=float(np.sum(self.heading_variance[keep])),
            raw=raw[0],
            fixes=raw[1],
        )


def sums_of(
    estimates: Sequence[Estimate],
    truth: Truth,
    plane: LocalPlane,
    raw: tuple[float, float],
    *,
    settled_s: float = SETTLED_S,
    start_ns: int = START_NS,
) -> Sums:
    """Score valid estimates of one filter on one boat from `settled_s` on; `raw` and `start_ns` as below."""
    errors = errors_of(estimates, truth, plane, start_ns)
    return errors.sums(errors.t_s >= settled_s, raw)


def errors_of(estimates: Sequence[Estimate], truth: Truth, plane: LocalPlane, start_ns: int = START_NS) -> Errors:
    """Errors of all estimates within the time of the truth, aligned or not; none at all give arrays of length 0.

    start_ns: boat time at the start of the truth's clock.
    """
    kept = [item for item in estimates if voyage_s(item.t_ns, start_ns) <= truth.t_s[-1]]
    t_s = np.array([voyage_s(item.t_ns, start_ns) for item in kept])
    seen = truth.at(t_s)
    places = np.array([plane.to_east_north_m(item.lat_deg, item.lon_deg) for item in kept]).reshape(-1, 2)
    P = np.array([_covariance(item) for item in kept]).reshape(-1, 5, 5)
    states = np.array([item.state[:5] for item in kept]).reshape(-1, 5)
    turned = states[:, HEADING] - seen.heading_rad
    return Errors(
        t_s=t_s,
        position_m=places - np.stack((seen.east_m, seen.north_m), axis=1),
        position_covariance=P[:, EAST : NORTH + 1, EAST : NORTH + 1],
        velocity_m_s=states[:, V_EAST : V_NORTH + 1] - np.stack((seen.v_east_m_s, seen.v_north_m_s), axis=1),
        velocity_variance=P[:, V_EAST, V_EAST] + P[:, V_NORTH, V_NORTH],
        heading_deg=np.degrees(np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi),
        heading_variance=np.degrees(np.sqrt(P[:, HEADING, HEADING])) ** 2,
    )


def voyage_s(t_ns: int, start_ns: int = START_NS) -> float:
    """Boat time as seconds since the start of the voyage."""
    return (t_ns - start_ns) / NS_PER_S


def _covariance(item: Estimate) -> Array:
    """The part of P of the five states, (5, 5)."""
    n = len(item.names)
    whole = np.zeros((n, n))
    whole[np.triu_indices(n)] = item.covariance
    return (whole + whole.T - np.diag(whole.diagonal()))[:5, :5]
