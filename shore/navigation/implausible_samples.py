"""Plausibility check of IMU samples (range gate): what no sensor can show is left out before it reaches the track."""

import math
from collections.abc import Sequence
from typing import Any, Final

from common.messages import ImuBlock

LARGEST_ACCEL_M_S2: Final = 160.0
"""16 g, the full scale of consumer units; more comes from a broken line, a wrong scale or a wrong model."""
LARGEST_YAW_RATE_DEG_S: Final = 2000.0
"""Full scale of consumer units."""
LIMITS: Final = (LARGEST_ACCEL_M_S2, LARGEST_ACCEL_M_S2, LARGEST_YAW_RATE_DEG_S)
"""Largest plausible magnitude on each of `IMU_AXES`: m/s^2, m/s^2, deg/s."""


def grouped(block: ImuBlock, limits: Sequence[float]) -> tuple[list[int], list[tuple[float, ...]], list[int]]:
    """Times (ns, increasing), mean (forward, starboard, yaw rate) and count of the plausible samples at each.

    Lines that came in one chunk share its stamp: together they cover what lies before it, so their mean does.
    """
    columns = zip(block.sample_t_ns, block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s, strict=False)
    at_time: dict[int, list[tuple[float, ...]]] = {}
    for t_ns, *values in columns:
        if is_plausible(values, limits):
            at_time.setdefault(t_ns, []).append(tuple(values))
    times_ns = sorted(at_time)
    return times_ns, [mean_of(at_time[t_ns]) for t_ns in times_ns], [len(at_time[t_ns]) for t_ns in times_ns]


def is_plausible(values: Sequence[float], limits: Sequence[float]) -> bool:
    """All of them finite and within the limits."""
    return all(math.isfinite(value) and abs(value) <= limit for value, limit in zip(values, limits, strict=True))


def mean_of(samples: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Mean of each column; one sample is its own, to the bit."""
    if len(samples) == 1:
        return samples[0]
    return tuple(sum(column) / len(samples) for column in zip(*samples, strict=True))
