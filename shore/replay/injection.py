"""Fault injection into a log: the frames of a replay as they would be with a broken sensor.

Measurements become readings (`common/simulation/readings.py`), a fault spoils them, and what it changed goes back into
the frame. What a fault does not change keeps every bit.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import compress
from typing import Final, TypeVar

from common.angles import wrap_deg
from common.boat_config import LATE_IMU_S, BoatConfig
from common.codec import decode_frame, encode_frame
from common.errors import CodecError, WayfixError
from common.framer import with_means
from common.messages import Attitude, ClockPair, Fix, Heading, ImuBlock, RawLine, TurnRate
from common.simulation.faults import Faults, faults_of
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Reading, Timed, TurnRateReading
from common.units import M_S_PER_KN, NS_PER_MS, NS_PER_S
from shore.watchers.watcher import Arrival

DAY_MS: Final = 86_400_000
M = TypeVar("M", Attitude, ClockPair, Fix, Heading, ImuBlock, RawLine, TurnRate)
_NO_SUMS: Final = (0.0, 0.0, 0.0, 0.0, 0)


class Injection:
    """The faults of one replay. Readings come in the order of the frames."""

    def __init__(self, texts: Sequence[str], config: BoatConfig) -> None:
        """Raises WayfixError for a sentence that does not fit the boat."""
        self._texts = tuple(texts)
        self._faults = faults_of(texts, config)
        self._spoiler = Faults(self._faults, config.sensor)
        self._roles = {sensor.id: sensor.role for sensor in config.sensor}
        self._sensors = {fault.sensor for fault in self._faults}
        self._imu_t_ns: dict[str, tuple[int, int]] = {}
        """Time of the last sample of each IMU, of those that came and of those that are given, ns."""
        self._beyond: dict[str, tuple[float, float, float, float, int]] = {}
        """What the faults added to the running sums of each IMU: of its three axes (m/s, m/s, deg), s, samples."""

    @property
    def counts(self) -> dict[str, int]:
        """Number of readings that each fault has changed so far, by its sentence."""
        return dict(zip(self._texts, self._spoiler.counts, strict=True))

    def spoil(self, arrival: Arrival) -> Arrival:
        """The arrival with its frame spoilt, as a station would decode it, and with the bytes of that frame.

        Raises WayfixError for values that no frame can carry.
        """
        frame, start_ns = arrival.frame, arrival.frame.t1_ns - round(arrival.t_s * NS_PER_S)
        spoilt = replace(
            frame,
            fixes=self._each(frame.fixes, self._fix, start_ns),
            headings=self._each(frame.headings, self._heading, start_ns),
            turn_rates=self._each(frame.turn_rates, self._turn_rate, start_ns),
            imu=self._each(frame.imu, self._block, start_ns),
            attitudes=self._each(frame.attitudes, self._beside, start_ns),
            clock_pairs=self._each(frame.clock_pairs, self._beside, start_ns),
            raw=self._each(frame.raw, self._beside, start_ns),
        )
        if spoilt == frame:
            return arrival
        try:
            data = encode_frame(spoilt)
        except CodecError as error:
            what = f"a fault gives what no frame can carry ({error.what})"
            raise WayfixError(what, "--inject", "give a smaller size") from error
        return arrival._replace(frame=decode_frame(data), data=data)

    def _each(self, given: tuple[M, ...], change: Callable[[M, int], M | None], start_ns: int) -> tuple[M, ...]:
        changed = (change(each, start_ns) if each.sensor in self._sensors else each for each in given)
        return tuple(each for each in changed if each is not None)

    def _spoilt(self, sensor: str, t_ns: int, start_ns: int, reading: Reading) -> Reading | None:
        timed = self._spoiler.spoil(Timed((t_ns - start_ns) / NS_PER_S, sensor, reading))
        return None if timed is None else timed.reading

    def _beside(self, each: M, start_ns: int) -> M | None:
        """What no fault changes; that of a sensor which gives nothing goes too."""
        t_s = (each.t_ns - start_ns) / NS_PER_S
        is_silent = any(
            fault.sensor == each.sensor and fault.kind == "dropout" and fault.covers(t_s) for fault in self._faults
        )
        return None if is_silent else each

    def _fix(self, fix: Fix, start_ns: int) -> Fix | None:
        """A fix without a place has nothing that can be spoilt but its being there."""
        if fix.lat_deg is None or fix.lon_deg is None:
            return self._beside(fix, start_ns)
        before = FixReading(fix.lat_deg, fix.lon_deg, *_velocity(fix), quality=fix.fix_quality or 0)
        after = self._spoilt(fix.sensor, fix.t_ns, start_ns, before)
        if not isinstance(after, FixReading):
            return None
        if after == before:
            return fix
        late_ns = round(after.late_s * NS_PER_S)
        sog_kn, cog_deg = _over_ground(fix, after)
        return replace(
            fix,
            lat_deg=after.lat_deg,
            lon_deg=after.lon_deg,
            sog_kn=sog_kn,
            cog_true_deg=cog_deg,
            fix_quality=fix.fix_quality if after.quality == before.quality else after.quality,
            utc_ns=None if fix.utc_ns is None else fix.utc_ns - late_ns,
            tod_ms=None if fix.tod_ms is None else (fix.tod_ms - late_ns // NS_PER_MS) % DAY_MS,
        )

    def _heading(self, heading: Heading, start_ns: int) -> Heading | None:
        shown_deg = heading.heading_true_deg if heading.heading_mag_deg is None else heading.heading_mag_deg
        if shown_deg is None:
            return heading
        after = self._spoilt(heading.sensor, heading.t_ns, start_ns, HeadingReading(shown_deg))
        if not isinstance(after, HeadingReading):
            return None
        if heading.heading_mag_deg is None:
            return replace(heading, heading_true_deg=after.heading_true_deg)
        return replace(heading, heading_mag_deg=after.heading_true_deg)

    def _turn_rate(self, rate: TurnRate, start_ns: int) -> TurnRate | None:
        """That of a rate gyro; what a compass says beside its heading only goes with it."""
        if self._roles[rate.sensor] != "gyro":
            return self._beside(rate, start_ns)
        after = self._spoilt(rate.sensor, rate.t_ns, start_ns, TurnRateReading(rate.rate_deg_s))
        return replace(rate, rate_deg_s=after.rate_deg_s) if isinstance(after, TurnRateReading) else None

    def _block(self, block: ImuBlock, start_ns: int) -> ImuBlock | None:
        """Samples spoilt one by one; the running sums are off by what was changed since the start of the log."""
        before = [ImuReading(*sample) for sample in _samples(block)]
        after = [
            self._spoilt(block.sensor, t_ns, start_ns, sample)
            for t_ns, sample in zip(block.sample_t_ns, before, strict=True)
        ]
        for t_ns, old, new in zip(block.sample_t_ns, before, after, strict=True):
            self._sum(block.sensor, t_ns, old, new)
        if after == before and self._beyond[block.sensor] == _NO_SUMS:
            return block
        kept = [sample for sample in after if isinstance(sample, ImuReading)]
        if not kept:
            return None
        offsets_us = tuple(compress(block.offset_us, (sample is not None for sample in after)))
        fwd, stb, yaw, seconds, count = self._beyond[block.sensor]
        return with_means(
            replace(
                block,
                t_ns=block.t_ns + 1000 * offsets_us[0],
                offset_us=tuple(offset_us - offsets_us[0] for offset_us in offsets_us),
                accel_fwd_m_s2=tuple(sample.accel_fwd_m_s2 for sample in kept),
                accel_stb_m_s2=tuple(sample.accel_stb_m_s2 for sample in kept),
                yaw_rate_deg_s=tuple(sample.yaw_rate_deg_s for sample in kept),
                sum_accel_fwd_m_s=block.sum_accel_fwd_m_s + fwd,
                sum_accel_stb_m_s=block.sum_accel_stb_m_s + stb,
                sum_yaw_deg=block.sum_yaw_deg + yaw,
                sum_time_s=max(block.sum_time_s + seconds, 0.0),
                sum_count=max(block.sum_count + count, 0),
            )
        )

    def _sum(self, sensor: str, t_ns: int, before: ImuReading, after: Reading | None) -> None:
        """What the board would have added for the spoilt sample, less what it added for the sample that came."""
        last_ns, last_kept_ns = self._imu_t_ns.get(sensor, (t_ns, t_ns))
        given = after if isinstance(after, ImuReading) else None
        self._imu_t_ns[sensor] = t_ns, t_ns if given else last_kept_ns
        old_s, new_s = _covered_s(last_ns, t_ns), _covered_s(last_kept_ns, t_ns) if given else 0.0
        new = given or ImuReading(0.0, 0.0, 0.0)
        fwd, stb, yaw, seconds, count = self._beyond.get(sensor, _NO_SUMS)
        self._beyond[sensor] = (
            fwd + new.accel_fwd_m_s2 * new_s - before.accel_fwd_m_s2 * old_s,
            stb + new.accel_stb_m_s2 * new_s - before.accel_stb_m_s2 * old_s,
            yaw + new.yaw_rate_deg_s * new_s - before.yaw_rate_deg_s * old_s,
            seconds + new_s - old_s,
            count - (given is None),
        )


def _covered_s(last_ns: int, t_ns: int) -> float:
    """The interval that a sample stands for, s; after a gap none."""
    return interval_s if 0.0 <= (interval_s := (t_ns - last_ns) / NS_PER_S) <= LATE_IMU_S else 0.0


def _samples(block: ImuBlock) -> Iterator[tuple[float, float, float]]:
    return zip(block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s, strict=True)


def _velocity(fix: Fix) -> tuple[float | None, float | None]:
    """(east, north) in m/s; `None` where the receiver gave no speed, or no course of a speed."""
    if fix.sog_kn is None or (fix.cog_true_deg is None and fix.sog_kn > 0.0):
        return None, None
    speed_m_s, course = fix.sog_kn * M_S_PER_KN, math.radians(fix.cog_true_deg or 0.0)
    return speed_m_s * math.sin(course), speed_m_s * math.cos(course)


def _over_ground(fix: Fix, after: FixReading) -> tuple[float | None, float | None]:
    """(SOG in kn, COG in deg) of a spoilt velocity; those of the fix where the velocity is the same."""
    east, north = after.v_east_m_s, after.v_north_m_s
    if east is None or north is None or (east, north) == _velocity(fix):
        return fix.sog_kn, fix.cog_true_deg
    sog_kn = math.hypot(east, north) / M_S_PER_KN
    return sog_kn, wrap_deg(math.degrees(math.atan2(east, north))) if sog_kn else None
