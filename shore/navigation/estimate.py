"""Filter output for people, logs and pages: degrees, knots, 1-sigma; plain numbers, never NaN."""

import math
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from common.angles import heading_deg
from common.geodesy import LocalPlane
from common.messages import Frame
from common.units import M_S_PER_KN
from shore.navigation.basis import Basis
from shore.navigation.filters import FilterState
from shore.navigation.initial_alignment import Waiting, aligned_parts
from shore.navigation.measurements import is_angle
from shore.navigation.numbers import Number
from shore.navigation.state_space import EAST, HEADING, NORTH, V_EAST, V_NORTH

MOST_DOUBT_M: Final = 500.0
"""1-sigma of a position, east and north together, beyond which nobody is shown a place."""
MOST_DOUBT_DEG: Final = 30.0
"""1-sigma of a direction beyond which nobody is shown a number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelReport:
    """How one channel of a sensor fits the filter. Heading and course in deg, the others in m."""

    sigma: float
    """Square root of R in use, deg or m."""
    dom_ratio: float | None
    """Degree of matching; `None` = the filter does not adapt, or has not yet."""
    nis: float | None
    """Normalised innovation squared of the last update, 1 expected; `None` = not updated yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One filter's answer for the end of one frame."""

    t_ns: int
    boot_id: str
    seq: int
    """Number of the frame that caused it, within its start of the daemon."""
    filter: str
    names: tuple[str, ...]
    """Names of the states, (n,); each ends in its unit."""
    state: tuple[float, ...]
    """The state in the units of `names`, (n,), on the local plane."""
    covariance: tuple[float, ...]
    """Upper triangle of P, row by row, in the same units."""
    origin_lat_deg: float
    origin_lon_deg: float
    lat_deg: float
    lon_deg: float
    heading_true_deg: float | None
    """`None` while its doubt is beyond `MOST_DOUBT_DEG`; the state holds the number that the filter works with."""
    sog_kn: float
    cog_true_deg: float | None
    """Course over ground, deg from true north; `None` while the speed is below its own sigma."""
    sigma_east_m: float
    sigma_north_m: float
    sigma_heading_deg: float
    aligned: bool
    """True when all parts of the estimate are valid: `waiting` is empty, and none has too much doubt."""
    waiting: tuple[str, ...]
    """What is not known yet (`shore.navigation.initial_alignment`)."""
    aligned_parts: tuple[str, ...]
    """The parts that are valid: `position` (with the velocity), `heading`; what has too much doubt is not."""
    position_from: str
    """What the position rests on: `fix`, or `coasting` (dead reckoning) when there is none."""
    position_since_ns: int
    """Boat time: of the first fix of an unbroken row; while coasting, of the last fix."""
    heading_from: str | None
    """What the heading rests on: `compass`, `course` (over ground) or `coasting`; `None` while there is none."""
    repairs: int
    """Number of times that P needed jitter since the start."""
    channels: dict[str, ChannelReport]

    def as_record(self) -> dict[str, Any]:
        """A plain dict for JSON."""
        values = [list(value) if isinstance(value, tuple) else value for value in _values(self)]
        record = dict(zip(self.__slots__, values, strict=True))
        reports = {
            channel: {"sigma": report.sigma, "dom_ratio": report.dom_ratio, "nis": report.nis}
            for channel, report in self.channels.items()
        }
        return record | {"channels": reports}


_values: Final = attrgetter(*Estimate.__slots__)
"""All fields at once: a record is made of each estimate of a replay."""


def estimate_of(
    state: FilterState, frame: Frame, plane: LocalPlane, *, name: str, t_ns: int, waiting: Waiting, basis: Basis
) -> Estimate | None:
    """The estimate of filter `name` at `t_ns`; `None` when the state is no place on earth."""
    values: list[float] = state.x.tolist()
    lat_deg, lon_deg = plane.to_lat_lon_deg(values[EAST], values[NORTH])
    sigmas = [math.sqrt(variance) for variance in state.P.diagonal().tolist()]
    if not all(map(math.isfinite, (*values, *sigmas, lat_deg, lon_deg))):
        return None
    v_east, v_north = values[V_EAST], values[V_NORTH]
    speed_m_s = math.hypot(v_east, v_north)
    is_moving = speed_m_s > max(sigmas[V_EAST], sigmas[V_NORTH])
    sigma_heading_deg = math.degrees(sigmas[HEADING])
    has_heading = sigma_heading_deg <= MOST_DOUBT_DEG
    has_place = math.hypot(sigmas[EAST], sigmas[NORTH]) <= MOST_DOUBT_M
    shown = {"position": has_place, "heading": has_heading}
    parts = tuple([part for part in aligned_parts(waiting) if shown[part]])
    return Estimate(
        t_ns=t_ns,
        boot_id=frame.boot_id,
        seq=frame.seq,
        filter=name,
        names=state.space.names,
        state=tuple(values),
        covariance=tuple(state.P.take(_upper_triangle(len(values))).tolist()),
        origin_lat_deg=plane.origin_lat_deg,
        origin_lon_deg=plane.origin_lon_deg,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        heading_true_deg=heading_deg(values[HEADING]) if has_heading else None,
        sog_kn=speed_m_s / M_S_PER_KN,
        cog_true_deg=heading_deg(math.atan2(v_east, v_north)) if is_moving else None,
        sigma_east_m=sigmas[EAST],
        sigma_north_m=sigmas[NORTH],
        sigma_heading_deg=sigma_heading_deg,
        aligned=not waiting and all(shown.values()),
        waiting=waiting,
        aligned_parts=parts,
        position_from=basis.position_from,
        position_since_ns=basis.position_since_ns,
        heading_from=basis.heading_from if has_heading else None,
        repairs=state.repairs,
        channels=_channels(state),
    )


@cache
def _upper_triangle(n: int) -> npt.NDArray[np.intp]:
    """Places of the upper triangle in a matrix (n, n) that is read row by row."""
    return np.flatnonzero(np.triu(np.ones((n, n))))


def _channels(state: FilterState) -> dict[str, ChannelReport]:
    reports = {}
    for channel, noise in state.noise.items():
        sigma = math.sqrt(noise.variance)
        reports[channel] = ChannelReport(
            sigma=math.degrees(sigma) if is_angle(channel) else sigma,
            dom_ratio=_plain(noise.dom_ratio),
            nis=_plain(noise.nis),
        )
    return reports


def _plain(number: Number | None) -> float | None:
    return None if number is None else float(number)
