"""Framing: measurements in, frames out on an absolute time grid; also merges frames to a longer period."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Final

from common.boat_config import LATE_IMU_S
from common.messages import (
    AisLine,
    Attitude,
    ClockPair,
    Event,
    Fix,
    Frame,
    Heading,
    ImuBlock,
    RadarTarget,
    RawLine,
    SensorHealth,
    TurnRate,
)
from common.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class ImuSample:
    """One reading of an inertial unit, covering the interval that ends at `t_ns`; the framer gathers them."""

    sensor: str
    t_ns: int
    accel_fwd_m_s2: float
    accel_stb_m_s2: float
    yaw_rate_deg_s: float


@dataclass(frozen=True, slots=True)
class Utc:
    """UTC of one boat time with its 1-sigma doubt and where it comes from."""

    utc_ns: int | None
    uncertainty_ns: int | None
    source: str


Measurement = Fix | ImuSample | Heading | TurnRate | Attitude | ClockPair | AisLine | RadarTarget | RawLine

_LIST_OF: Final[dict[type, str]] = {
    Fix: "fixes",
    Heading: "headings",
    TurnRate: "turn_rates",
    Attitude: "attitudes",
    ClockPair: "clock_pairs",
    AisLine: "ais",
    RadarTarget: "radar",
    RawLine: "raw",
    Event: "events",
}
_LISTS: Final = tuple(_LIST_OF.values())


@dataclass(frozen=True, slots=True)
class Identity:
    """What every frame of one daemon start has in common."""

    boat_id: str
    boot_id: str
    clock_id: str
    start_no: int


class ImuGatherer:
    """Columns, means and running sums of one IMU."""

    def __init__(self, sensor: str) -> None:
        self._sensor = sensor
        self._samples: list[ImuSample] = []
        self._last_ns: int | None = None
        self._sums = [0.0, 0.0, 0.0]
        self._count = 0
        self._time_s = 0.0

    def add(self, sample: ImuSample) -> None:
        """Take one sample into the block being gathered."""
        self._samples.append(sample)

    def take(self, t1_ns: int) -> ImuBlock | None:
        """The samples before `t1_ns` as a block, or None when there are none; later ones wait."""
        samples = [sample for sample in self._samples if sample.t_ns < t1_ns]
        if not samples:
            return None
        self._samples = [sample for sample in self._samples if sample.t_ns >= t1_ns]
        for t_ns, together in groupby(samples, key=lambda sample: sample.t_ns):
            self._integrate(t_ns, list(together))
        first_ns = min(sample.t_ns for sample in samples)
        return with_means(
            ImuBlock(
                sensor=self._sensor,
                t_ns=first_ns,
                offset_us=tuple((sample.t_ns - first_ns) // 1000 for sample in samples),
                accel_fwd_m_s2=_f32(sample.accel_fwd_m_s2 for sample in samples),
                accel_stb_m_s2=_f32(sample.accel_stb_m_s2 for sample in samples),
                yaw_rate_deg_s=_f32(sample.yaw_rate_deg_s for sample in samples),
                sum_accel_fwd_m_s=self._sums[0],
                sum_accel_stb_m_s=self._sums[1],
                sum_yaw_deg=self._sums[2],
                sum_count=self._count,
                sum_time_s=self._time_s,
            )
        )

    def _integrate(self, t_ns: int, samples: list[ImuSample]) -> None:
        """A sample covers the interval that ends at its time; those of one chunk share it, and their mean counts."""
        if self._last_ns is not None and 0 < t_ns - self._last_ns <= LATE_IMU_S * NS_PER_S:
            dt_s = (t_ns - self._last_ns) / NS_PER_S
            self._sums[0] += _mean([sample.accel_fwd_m_s2 for sample in samples]) * dt_s
            self._sums[1] += _mean([sample.accel_stb_m_s2 for sample in samples]) * dt_s
            self._sums[2] += _mean([sample.yaw_rate_deg_s for sample in samples]) * dt_s
            self._time_s += dt_s
        self._last_ns = t_ns
        self._count += len(samples)


class Framer:
    """Gathers what arrives between two ticks."""

    def __init__(self, identity: Identity, imus: Iterable[str], t0_ns: int) -> None:
        """Imus: their sensor ids; t0_ns: start of the first frame."""
        self.identity = identity
        self.next_seq = 0
        self.t0_ns = t0_ns
        self._imus = {sensor: ImuGatherer(sensor) for sensor in imus}
        self._lists: dict[str, list[Any]] = {name: [] for name in _LISTS}

    def add(self, measurement: Measurement | Event) -> None:
        """Take one measurement or event into the frame being gathered."""
        if isinstance(measurement, ImuSample):
            self._imus[measurement.sensor].add(measurement)
        else:
            self._lists[_LIST_OF[type(measurement)]].append(measurement)

    def tick(self, t1_ns: int, utc: Utc, clk_epoch: int, health: Iterable[SensorHealth]) -> Frame:
        """Close the frame [t0, t1) and begin the next.

        What is stamped t1 or later waits, so that a late tick (busy board, fast clock) changes nothing in the frames.
        """
        events, self._lists["events"] = self._lists["events"], []  # reported when known, whatever their stamp
        lists: dict[str, Any] = {
            name: tuple(item for item in items if item.t_ns < t1_ns) for name, items in self._lists.items()
        }
        self._lists = {name: [item for item in items if item.t_ns >= t1_ns] for name, items in self._lists.items()}
        lists["events"] = tuple(events)
        blocks = (gatherer.take(t1_ns) for gatherer in self._imus.values())
        frame = Frame(
            boat_id=self.identity.boat_id,
            boot_id=self.identity.boot_id,
            seq=self.next_seq,
            clock_id=self.identity.clock_id,
            start_no=self.identity.start_no,
            t0_ns=self.t0_ns,
            t1_ns=t1_ns,
            utc_ns=utc.utc_ns,
            utc_unc_ns=utc.uncertainty_ns,
            utc_src=utc.source,
            clk_epoch=clk_epoch,
            imu=tuple(block for block in blocks if block is not None),
            health=tuple(health),
            **lists,
        )
        self.next_seq += 1
        self.t0_ns = t1_ns
        return frame


def merge(frames: Sequence[Frame]) -> Frame:
    """One frame over several consecutive ones: the last one's identity, `first_seq` of the first."""
    first, last = frames[0], frames[-1]
    lists: dict[str, Any] = {name: tuple(item for frame in frames for item in getattr(frame, name)) for name in _LISTS}
    blocks: dict[str, ImuBlock] = {}
    for frame in frames:
        for block in frame.imu:
            blocks[block.sensor] = _joined(blocks[block.sensor], block) if block.sensor in blocks else block
    health = {report.sensor: report for frame in frames for report in frame.health}
    return replace(
        last,
        first_seq=first.seq,
        t0_ns=first.t0_ns,
        utc_ns=None if last.utc_ns is None else last.utc_ns - (last.t0_ns - first.t0_ns),
        imu=tuple(with_means(block) for block in blocks.values()),
        health=tuple(health.values()),
        **lists,
    )


def with_means(block: ImuBlock) -> ImuBlock:
    """The block with its three means filled in (journal paper, section 5: the IMU averaged over a filter step)."""
    return replace(
        block,
        mean_accel_fwd_m_s2=_mean(block.accel_fwd_m_s2),
        mean_accel_stb_m_s2=_mean(block.accel_stb_m_s2),
        mean_yaw_rate_deg_s=_mean(block.yaw_rate_deg_s),
    )


def _joined(a: ImuBlock, b: ImuBlock) -> ImuBlock:
    """Columns of both; the sums are running ones, so the later block's hold."""
    start_ns = min(a.t_ns, b.t_ns)
    times_ns = a.sample_t_ns + b.sample_t_ns
    return replace(
        b,
        t_ns=start_ns,
        offset_us=tuple((t_ns - start_ns) // 1000 for t_ns in times_ns),
        accel_fwd_m_s2=a.accel_fwd_m_s2 + b.accel_fwd_m_s2,
        accel_stb_m_s2=a.accel_stb_m_s2 + b.accel_stb_m_s2,
        yaw_rate_deg_s=a.yaw_rate_deg_s + b.yaw_rate_deg_s,
    )


def _f32(values: Iterable[float]) -> tuple[float, ...]:
    """Rounded to f32 at once, so that the board and every reader hold the same numbers."""
    values = tuple(values)
    return struct.unpack(f"<{len(values)}f", struct.pack(f"<{len(values)}f", *values))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
