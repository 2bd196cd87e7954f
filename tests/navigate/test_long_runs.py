"""Any interval between measurements, and a whole day with outages: finite, positive definite, its own doubt right."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.boat_config import BoatConfig, SensorTable
from common.messages import ImuBlock
from shore.navigation.filter_bank import Bank, Batch, Moment
from shore.navigation.filter_registry import build_filter
from shore.navigation.imu_track import ImuTrack
from shore.navigation.initial_state import first_of
from shore.navigation.measurements import Measurement, Position, TrueHeading
from shore.navigation.motion_model import FREE_NOISE, ImuInput, ProcessNoise, move
from shore.navigation.numbers import Array
from shore.navigation.sensor_facts import facts_of
from shore.navigation.state_space import HEADING
from shore.navigation.timeline import Timeline
from tests.navigate.voyages import BOAT, UNCALIBRATED, state_of

S = 10**9
NAMES = ("kf", "ekf", "ukf", "fuzzy", "fuzzy-thesis")


def timeline_of(config: BoatConfig, names: tuple[str, ...]) -> tuple[Timeline, Bank]:
    facts = facts_of(config).plain
    bank = Bank([build_filter(name, facts) for name in names], has_compass=True)
    return Timeline(bank, ImuTrack(config.with_role("imu")[0])), bank


def block(t_ns: int, imu: ImuInput) -> ImuBlock:
    """One sample."""
    return ImuBlock(
        sensor="imu1", t_ns=t_ns, offset_us=(0,), accel_fwd_m_s2=(float(imu.accel_fwd_m_s2),),
        accel_stb_m_s2=(float(imu.accel_stb_m_s2),), yaw_rate_deg_s=(math.degrees(imu.yaw_rate_rad_s),),
    )  # fmt: skip


def least_eigenvalue(P: Array) -> float:
    """Of P with every variance scaled to 1, so that metres and radians count alike."""
    sigma = np.sqrt(np.diagonal(P))
    return float(np.linalg.eigvalsh(P / np.outer(sigma, sigma))[0])


heard = st.tuples(
    st.floats(0.0, math.log10(600_000.0)).map(lambda power: round(10**power) * 10**6),
    st.sets(st.sampled_from(("fix", "heading", "imu"))),
    st.floats(-1.0, 1.0),
)
"""Silence before it, from 1 ms to 10 min (ns); what comes then; a number that all its values are made of."""


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.sampled_from((BOAT, UNCALIBRATED)), st.lists(heard, min_size=1, max_size=25))
def test_after_any_silence_every_filter_is_finite_and_positive_definite(config: BoatConfig, events: list[Any]) -> None:
    timeline, bank = timeline_of(config, NAMES)
    doubts = [0.0] * len(NAMES)
    t_ns = S
    timeline.push(Batch(t_ns, "b", (Position(t_ns, "gps1", 0.0, 0.0), TrueHeading(t_ns, "compass1", 3.1)), ()))
    for dt_ns, kinds, number in events:
        t_ns += dt_ns
        measured: list[Measurement] = []
        if "fix" in kinds:
            measured.append(Position(t_ns, "gps1", 100.0 * number, -50.0 * number))
        if "heading" in kinds:
            measured.append(TrueHeading(t_ns, "compass1", math.pi * number))
        blocks = (block(t_ns, ImuInput(3.0 * number, -number, number)),) if "imu" in kinds else ()
        (moment,) = timeline.push(Batch(t_ns, "b", tuple(measured), blocks))
        for index in range(len(NAMES)):
            state = state_of(moment, index)
            assert np.isfinite(state.x).all()
            assert abs(state.x[HEADING]) <= math.pi
            assert least_eigenvalue(state.P) > 0.0
            assert state.repairs == 0
            if config is BOAT and not kinds:
                assert state.P[HEADING, HEADING] > doubts[index]
            doubts[index] = state.P[HEADING, HEADING]
    assert bank.resets == []


DAY_S = 24 * 3600
ACCEL, GYRO_DEG, SIGMA_M, SIGMA_DEG = 0.05, 0.2, 3.0, 2.0
IMU = SensorTable(
    id="imu1", port="p", role="imu", rate_hz=1.0, accel_density=ACCEL, gyro_density_deg=GYRO_DEG,
    bias_accel_sigma_m_s2=0.05, bias_accel_walk_m_s2=0.0005, bias_yaw_rate_sigma_deg_s=0.3,
    bias_yaw_rate_walk_deg_s=0.001, tilt_leak_sigma_per_m=0.0,
)  # fmt: skip
SENSORS = (
    SensorTable(id="gps1", port="p", role="gps", rate_hz=1.0, sigma_m=SIGMA_M),
    SensorTable(id="compass1", port="p", role="compass", rate_hz=1.0, sigma_deg=SIGMA_DEG),
    IMU,
)
HELD_S = 3
"""An IMU of 1 Hz is held for three of its periods."""


@dataclass
class Second:
    """What happens in one second of the day."""

    imu: bool = True
    gps: bool = True
    compass: bool = True


def plan(rng: np.random.Generator) -> list[Second]:
    """Each hour a gap of ten minutes, outages of one sensor for up to two minutes in between."""
    seconds = [Second() for _ in range(DAY_S)]
    for hour in range(24):
        start = hour * 3600 + int(rng.integers(1200, 2900))
        seconds[start : start + 600] = [Second(False, False, False) for _ in range(600)]
        for kind in ("gps", "gps", "compass", "imu"):
            start = hour * 3600 + int(rng.integers(60, 3300))
            for second in seconds[start : start + int(rng.integers(10, 120))]:
                setattr(second, kind, False)
    return seconds


class Sea:
    """A boat moved by the filter's own model: driven by the IMU less its errors, and by free noise without one."""

    def __init__(self, rng: np.random.Generator, x: Array) -> None:
        self.x = x
        self._rng = rng
        self._rate = 0.0
        self._held = ImuInput(0.0, 0.0, 0.0)
        self._silent_s = 0

    def second(self, space: Any, has_imu: bool) -> ImuInput:
        """Move on by a second; what the IMU showed (or would have)."""
        rng, noise = self._rng, ProcessNoise(ACCEL, ACCEL, math.radians(GYRO_DEG))
        self._silent_s = 0 if has_imu else self._silent_s + 1
        if has_imu:
            self._rate = 0.98 * self._rate + math.sqrt(0.04) * math.radians(2.0) * rng.normal()
            sin, cos = math.sin(self.x[HEADING]), math.cos(self.x[HEADING])
            slow_east, slow_north = 0.02 * (1.0 * sin - self.x[2]), 0.02 * (1.0 * cos - self.x[3])
            fwd, stb = sin * slow_east + cos * slow_north, cos * slow_east - sin * slow_north
            self._held = ImuInput(fwd, stb, self._rate)
        is_driven = self._silent_s <= HELD_S
        shown = self._held if is_driven else None
        self.x = move(space, self.x, 1.0, shown)
        density = np.array((noise if is_driven else FREE_NOISE)[:3], dtype=float)
        fwd, stb, turn = density * rng.normal(size=3)
        sin, cos = math.sin(self.x[HEADING]), math.cos(self.x[HEADING])
        east, north = sin * fwd + cos * stb, cos * fwd - sin * stb
        self.x[:5] += (0.5 * east, 0.5 * north, east, north, turn)
        walks = rng.normal(size=len(self.x))
        for place, extra in space.walks:
            self.x[place] += extra.walk * walks[place]
        return self._held


@pytest.mark.slow
def test_a_day_with_outages_and_gaps_of_ten_minutes() -> None:
    names = ("fuzzy",)
    config = replace(BOAT, sensor=SENSORS)
    rng = np.random.default_rng(24)
    timeline, bank = timeline_of(config, names)
    facts = facts_of(config).plain
    _, P = first_of(facts, (0.0,) * 5, (SIGMA_M**2, SIGMA_M**2, 1.0, 1.0, math.radians(SIGMA_DEG) ** 2))
    sea = Sea(rng, np.sqrt(np.diagonal(P)) * rng.normal(size=len(P)))
    scores: list[list[float]] = []
    crossings, before = 0, 0.0
    for k, second in enumerate(plan(rng)):
        t_ns = (k + 1) * S
        shown = sea.second(facts.space, second.imu)
        if not (second.imu or second.gps or second.compass):
            continue
        measured: list[Measurement] = []
        if second.gps:
            east, north = (float(each) for each in sea.x[:2] + SIGMA_M * rng.normal(size=2))
            measured.append(Position(t_ns, "gps1", east, north))
        if second.compass:
            angle = math.remainder(float(sea.x[HEADING] + math.radians(SIGMA_DEG) * rng.normal()), math.tau)
            crossings += abs(angle - before) < 1.0 and (angle < 0.0) != (before < 0.0)
            before = angle
            measured.append(TrueHeading(t_ns, "compass1", angle))
        blocks = (block(t_ns, shown),) if second.imu else ()
        (moment,) = timeline.push(Batch(t_ns, "b", tuple(measured), blocks))
        if k > 60 and k % 10 == 0:
            scores.append(nees(moment, sea.x, len(names)))
    assert bank.resets == []
    assert crossings > 100
    anees = np.mean(scores, axis=0)
    print(f"{len(scores)} points, {crossings} crossings of north, ANEES {dict(zip(names, anees, strict=True))}")
    assert np.all((anees >= 4.5) & (anees <= 6.0)), anees


def nees(moment: Moment, truth: Array, count: int) -> list[float]:
    """Of the thesis' five states, for each filter; finite and positive definite on the way."""
    scores = []
    for index in range(count):
        state = state_of(moment, index)
        assert least_eigenvalue(state.P) > 0.0
        error = (state.x - truth)[:5]
        error[HEADING] = math.remainder(error[HEADING], math.tau)
        scores.append(float(error @ np.linalg.solve(state.P[:5, :5], error)))
    assert np.isfinite(scores).all()
    return scores
