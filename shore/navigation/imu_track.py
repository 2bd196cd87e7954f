"""Zero-order hold of the IMU (without one, of a rate gyro): which input drives each stretch of the track.

A sample covers the interval that ends at its time, up to `LATE_IMU_S`. In a longer gap, and after the newest sample,
the last one is held for `hold_ns`, then nothing is known (`None`). Where frames are missing, the difference of
the running sums is one coarse sample over the gap. Samples that no sensor can show are left out, and no sum that holds
one bridges a gap. All of it depends on the set of blocks only, not on their arrival.
"""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final, NamedTuple

from common.boat_config import IMU_AXES, LATE_IMU_S, ROLES, BoatConfig, SensorTable
from common.messages import Frame, ImuBlock
from common.units import NS_PER_S, NS_PER_US
from shore.navigation.gravity import levelled
from shore.navigation.implausible_samples import LIMITS, grouped, is_plausible, mean_of
from shore.navigation.motion_model import ImuInput

HOLD_S: Final = 0.25
HOLD_PERIODS: Final = 3.0
_LATE_NS: Final = int(LATE_IMU_S * NS_PER_S)
REPEATED: Final = 5
"""So many samples in a row that are alike on all axes come from a unit that has stopped measuring: noise never
repeats three numbers at once. A rate gyro alone may, at rest."""
LONGEST_STEP_S: Final = 1.0
MOST_STEPS: Final = 10
"""A stretch above 1 s is predicted in up to ten equal steps: P is then within 1/(4 x 10^2) of the continuous one."""


class Stretch(NamedTuple):
    """One input that holds over (start, end]."""

    start_ns: int
    end_ns: int
    imu: ImuInput | None
    """`None` = the unit repeats its numbers."""


class TimeStep(NamedTuple):
    """One prediction: its length and what drives it."""

    dt_s: float
    imu: ImuInput | None


@dataclass(slots=True)
class _Block:
    """The plausible samples of a block, biases removed, in SI; `stretches` depend on the blocks before it."""

    boot_id: str
    source: ImuBlock
    end_ns: int
    """Time of the last sample, plausible or not."""
    times_ns: list[int]
    inputs: list[ImuInput]
    counts: list[int]
    """Number of samples of which each input is the mean."""
    stretches: list[Stretch] = field(default_factory=list)
    run: int = 0
    """How many samples in a row, up to its last one, are alike."""

    @property
    def left_out(self) -> int:
        """Samples that are not plausible."""
        return len(self.source.offset_us) - sum(self.counts)


class ImuTrack:
    """Blocks of one IMU in order of time."""

    def __init__(self, sensor: SensorTable) -> None:
        self._sensor = sensor
        rate_hz = sensor.rate_hz or ROLES[sensor.role].nominal_rate_hz
        self._period_ns = int(NS_PER_S / rate_hz)
        self._hold_ns = int(max(HOLD_S, HOLD_PERIODS / rate_hz) * NS_PER_S)
        self._blocks: list[_Block] = []
        self._stretches: list[Stretch] = []
        self._ends_ns: list[int] = []
        # An axis that is not used may show anything: it is often left out because it is broken.
        axes = zip(IMU_AXES, LIMITS, strict=True)
        self._limits = tuple(limit if axis in sensor.use else math.inf for axis, limit in axes)
        self._can_repeat = sensor.role == "imu" and len(sensor.use) == len(IMU_AXES)
        self.left_out = 0
        """Number of samples that were no plausible numbers."""

    def insert(self, block: ImuBlock, boot_id: str) -> tuple[int, int] | None:
        """Take in a block in any order. Returns the time after which the track has changed and the block's last sample.

        `None` when it is known already or changes nothing.
        """
        place = bisect_left(self._blocks, block.t_ns, key=lambda known: known.source.t_ns)
        if not block.offset_us or (place < len(self._blocks) and self._blocks[place].source == block):
            return None
        fresh = self._decode(block, boot_id)
        self.left_out += fresh.left_out
        self._blocks.insert(place, fresh)
        fresh.stretches = self._cover(place)
        lost_ns = self._cover_later(place + 1)
        self._flatten(place)
        if fresh.times_ns:
            starts_ns = [stretch.start_ns for stretch in fresh.stretches[:1]]
            return min([fresh.times_ns[0] - 1, *starts_ns]), fresh.times_ns[-1]
        return None if lost_ns is None else (lost_ns, fresh.end_ns)

    @property
    def repeats(self) -> bool:
        """True while the newest samples are all alike: the unit has stopped measuring."""
        return bool(self._blocks) and self._blocks[-1].run >= REPEATED

    def forget_before(self, t_ns: int) -> None:
        """Drop blocks that ended before `t_ns`, except the newest of them."""
        old = bisect_left(self._blocks, t_ns, key=lambda block: block.end_ns) - 1
        if old > 0:
            stretches = sum(len(block.stretches) for block in self._blocks[:old])
            del self._blocks[:old], self._stretches[:stretches], self._ends_ns[:stretches]

    def steps(self, from_ns: int, to_ns: int) -> list[TimeStep]:
        """The predictions that lead from one time to a later one."""
        index = bisect_right(self._ends_ns, from_ns)
        now_ns, steps = from_ns, []
        while now_ns < to_ns:
            end_ns, imu = self._next(index, now_ns)
            end_ns = to_ns if end_ns is None else min(end_ns, to_ns)
            if end_ns > now_ns:
                steps += split(now_ns, end_ns, imu)
                now_ns = end_ns
            while index < len(self._ends_ns) and self._ends_ns[index] <= now_ns:
                index += 1
        return steps

    def mean(self, from_ns: int, to_ns: int) -> ImuInput | None:
        """Plain mean of the samples in (from, to]; `None` without any."""
        samples = [
            imu
            for block in self._blocks
            for t_ns, imu, count in zip(block.times_ns, block.inputs, block.counts, strict=True)
            for _ in range(count)
            if from_ns < t_ns <= to_ns
        ]
        return ImuInput(*mean_of(samples)) if samples else None

    def _next(self, index: int, now_ns: int) -> tuple[int | None, ImuInput | None]:
        """Input from `now_ns` on, and until when (`None` = for ever); `index` is the first stretch that ends later."""
        following = self._stretches[index] if index < len(self._stretches) else None
        if following and following.start_ns <= now_ns:
            return following.end_ns, following.imu
        until_ns = following.start_ns if following else None
        if index:
            held = self._stretches[index - 1]
            held_until_ns = held.end_ns + self._hold_ns
            if now_ns < held_until_ns:
                return (held_until_ns if until_ns is None else min(held_until_ns, until_ns)), held.imu
        return until_ns, None

    def _flatten(self, place: int) -> None:
        """Renew the list of all stretches after a block came to `place`, most often the last."""
        if place < len(self._blocks) - 1:
            self._stretches, self._ends_ns, place = [], [], 0
        for block in self._blocks[place:]:
            self._stretches += block.stretches
            self._ends_ns += [stretch.end_ns for stretch in block.stretches]

    def _decode(self, block: ImuBlock, boot_id: str) -> _Block:
        """Samples in order of time."""
        times_ns, means, counts = grouped(block, self._limits)
        inputs = [self._input(*mean) for mean in means]
        return _Block(boot_id, block, max(block.sample_t_ns), times_ns, inputs, counts)

    def _input(self, fwd: float, stb: float, yaw_deg: float) -> ImuInput:
        """Known biases removed (thesis Eqs 3.2, 3.3), unused axes 0, rad/s."""
        sensor = self._sensor
        return ImuInput(
            fwd - sensor.bias_accel_fwd_m_s2 if "accel_fwd" in sensor.use else 0.0,
            stb - sensor.bias_accel_stb_m_s2 if "accel_stb" in sensor.use else 0.0,
            math.radians(yaw_deg - sensor.bias_yaw_rate_deg_s) if "yaw_rate" in sensor.use else 0.0,
        )

    def _cover_later(self, place: int) -> int | None:
        """Renew the stretches up to the next block with samples; returns the first time that they cover otherwise."""
        first_ns: int | None = None
        for index in range(place, len(self._blocks)):
            block = self._blocks[index]
            if block.times_ns:
                known, run, block.stretches = block.stretches, block.run, self._cover(index)
                if known == block.stretches and run == block.run:
                    return first_ns
                changed = [s.start_ns for s in (*known[:1], *block.stretches[:1])]
                first_ns = min(changed if first_ns is None else [first_ns, *changed])
                if run == block.run:
                    return first_ns
        return first_ns

    def _cover(self, place: int) -> list[Stretch]:
        """The stretches of a block, given those before it."""
        block = self._blocks[place]
        if not block.times_ns:
            return []
        earlier = self._blocks[place - 1 :: -1] if place else []
        last_ns = next((before.times_ns[-1] for before in earlier if before.times_ns), None)
        stretches = []
        known = next((before for before in earlier if before.times_ns), None)
        last, run = (known.inputs[-1], known.run) if known else (None, 0)
        coarse = self._coarse(earlier[0], block) if earlier else None
        if coarse:
            stretches.append(coarse)
            last_ns = coarse.end_ns
        for t_ns, imu, count in zip(block.times_ns, block.inputs, block.counts, strict=True):
            if last_ns is None or t_ns - last_ns > _LATE_NS:
                last_ns = max(last_ns or 0, t_ns - count * self._period_ns)
            run, last = run + 1 if imu == last else 1, imu
            if t_ns > last_ns:
                is_repeated = self._can_repeat and run >= REPEATED
                stretches.append(Stretch(last_ns, t_ns, None if is_repeated else imu))
                last_ns = t_ns
        block.run = run if self._can_repeat else 0
        return stretches

    def _coarse(self, before: _Block, block: _Block) -> Stretch | None:
        """Mean over missing blocks: difference of the running sums less the block's own part.

        `None` where that is not known: the sums of a block hold the samples that were left out of it.
        """
        later, earlier = block.source, before.source
        missing = later.sum_count - earlier.sum_count - len(later.offset_us)
        covered_s = later.sum_time_s - earlier.sum_time_s
        if block.boot_id != before.boot_id or missing <= 0 or covered_s <= 0.0 or block.left_out:
            return None
        period_s = covered_s / (missing + len(later.offset_us))
        _, own_means, _ = grouped(later, self._limits)
        own_s = [period_s, *((b - a) / NS_PER_S for a, b in pairwise(block.times_ns))]
        gap_s = covered_s - sum(own_s)
        end_ns = block.times_ns[0] - round(period_s * NS_PER_S)
        if gap_s <= 0.0 or end_ns <= before.end_ns:
            return None
        totals = (
            later.sum_accel_fwd_m_s - earlier.sum_accel_fwd_m_s,
            later.sum_accel_stb_m_s - earlier.sum_accel_stb_m_s,
            later.sum_yaw_deg - earlier.sum_yaw_deg,
        )
        columns = zip(*own_means, strict=True)
        means = [
            (total - sum(map(float.__mul__, own_s, column))) / gap_s
            for total, column in zip(totals, columns, strict=True)
        ]
        if not is_plausible(means, self._limits):
            return None
        return Stretch(before.end_ns, end_ns, self._input(*means))


def driving_sensor(config: BoatConfig) -> SensorTable | None:
    """What drives the filters: the first IMU if any of its axes is used; without one, the first rate gyro."""
    imus = (sensor for sensor in config.with_role("imu") if sensor.use)
    gyros = (replace(sensor, use=("yaw_rate",)) for sensor in config.with_role("gyro"))
    return next(iter((*imus, *gyros)), None)


def blocks_of(frame: Frame, sensor: SensorTable) -> tuple[ImuBlock, ...]:
    """The frame's samples of the driving sensor; the rates of a gyro as a block without accelerations."""
    if sensor.role == "imu":
        blocks = tuple(block for block in frame.imu if block.sensor == sensor.id)
        tilts = [each for each in frame.attitudes if each.sensor == sensor.id] if sensor.trust_tilt else []
        return tuple(levelled(block, tilts) for block in blocks)
    rates = sorted((rate.t_ns, rate.rate_deg_s) for rate in frame.turn_rates if rate.sensor == sensor.id)
    if not rates:
        return ()
    first_ns, none = rates[0][0], (0.0,) * len(rates)
    return (
        ImuBlock(
            sensor=sensor.id,
            t_ns=first_ns,
            offset_us=tuple((t_ns - first_ns) // NS_PER_US for t_ns, _ in rates),
            accel_fwd_m_s2=none,
            accel_stb_m_s2=none,
            yaw_rate_deg_s=tuple(rate for _, rate in rates),
        ),
    )


def split(start_ns: int, end_ns: int, imu: ImuInput | None) -> list[TimeStep]:
    """One stretch as equal steps of at most 1 s, or as ten longer ones."""
    dt_s = (end_ns - start_ns) / NS_PER_S
    count = min(MOST_STEPS, math.ceil(dt_s / LONGEST_STEP_S))
    return [TimeStep(dt_s / count, imu)] * count
