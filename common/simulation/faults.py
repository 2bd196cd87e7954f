"""Fault injection: what a broken, wrongly mounted or disturbed sensor gives instead of its readings.

A fault is a function from reading to reading; some remember, or draw noise. It knows neither truth nor filter, so the
same sentence (`fault_text.py`) spoils the readings of a virtual boat and those of a log.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from common.angles import wrap_deg
from common.boat_config import ROLES, BoatConfig, SensorTable
from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.simulation.fault_text import ACCELERATION, HEADING, PLACE, TURN_RATE, VELOCITY, SensorFault, fault_of
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Reading, Timed, TurnRateReading
from common.simulation.voyage import Voyage
from common.units import M_S_PER_KN

Change = Callable[[Timed], Timed | None]
"""What becomes of a reading; `None` = nothing comes. It is called for every reading of the sensor, in order of time,
also before and after the fault."""

NOTHING_CHANGED: Final = "look at its time, and whether the sensor gives what it is about (a receiver its velocity)"
"""Cure where a fault finds no reading that it changes."""
KNOWN_NOISE_M_S: Final = 0.1
"""1-sigma on an axis of a receiver's velocity, m/s, for `noise xN`: the boat's file does not state it."""


class Faults:
    """All faults of a boat, applied to one reading after the other."""

    def __init__(self, faults: Sequence[SensorFault], sensors: Iterable[SensorTable], seed: int = 1) -> None:
        """seed: of the noise that faults add."""
        tables = {sensor.id: sensor for sensor in sensors}
        self._changes: dict[str, list[tuple[int, Change]]] = {}
        for index, fault in enumerate(faults):
            change = _change_of(fault, tables[fault.sensor], np.random.default_rng((seed, index)))
            self._changes.setdefault(fault.sensor, []).append((index, change))
        self.counts = [0] * len(faults)
        """Number of readings that each fault has changed."""

    def spoil(self, timed: Timed) -> Timed | None:
        """What the sensor gives instead; faults of one sensor apply in the order in which they were named."""
        for index, change in self._changes.get(timed.sensor, ()):
            spoilt = change(timed)
            self.counts[index] += spoilt != timed
            if spoilt is None:
                return None
            timed = spoilt
        return timed


def faults_of(texts: Sequence[str], config: BoatConfig, where: str = "--inject") -> tuple[SensorFault, ...]:
    """The faults that sentences name; raises WayfixError for one that does not fit the boat."""
    roles = {sensor.id: sensor.role for sensor in config.sensor}
    return tuple(fault_of(text, roles, where) for text in texts)


def with_faults(voyage: Voyage, texts: Sequence[str], seed: int = 1, where: str = "--inject") -> Voyage:
    """The voyage with faults in its readings. Raises WayfixError for one that does not fit, or that changes nothing."""
    if not texts:
        return voyage
    faults = Faults(faults_of(texts, voyage.config, where), voyage.config.sensor, seed)
    spoilt = tuple(timed for each in voyage.readings if (timed := faults.spoil(each)) is not None)
    for text, count in zip(texts, faults.counts, strict=True):
        if not count:
            raise WayfixError(f"{text!r} changes nothing", where, NOTHING_CHANGED)
    return replace(voyage, readings=spoilt)


def shifted(reading: Reading, quantity: str, amount: float, toward_deg: float) -> Reading:
    """A reading with one quantity larger by `amount` (m, m/s, deg, deg/s, m/s^2); place and velocity toward an angle.

    A quantity that it does not hold stays missing.
    """
    east, north = amount * math.sin(math.radians(toward_deg)), amount * math.cos(math.radians(toward_deg))
    match reading:
        case FixReading() if quantity == PLACE:
            return _moved(reading, east, north)
        case FixReading(v_east_m_s=float() as v_east, v_north_m_s=float() as v_north) if quantity == VELOCITY:
            return replace(reading, v_east_m_s=v_east + east, v_north_m_s=v_north + north)
        case HeadingReading() if quantity == HEADING:
            return replace(reading, heading_true_deg=wrap_deg(reading.heading_true_deg + amount))
        case TurnRateReading() if quantity == TURN_RATE:
            return TurnRateReading(reading.rate_deg_s + amount)
        case ImuReading() if quantity == TURN_RATE:
            return replace(reading, yaw_rate_deg_s=reading.yaw_rate_deg_s + amount)
        case ImuReading() if quantity == ACCELERATION:
            return replace(reading, accel_fwd_m_s2=reading.accel_fwd_m_s2 + amount)
        case _:
            return reading


def _moved(fix: FixReading, east_m: float, north_m: float) -> FixReading:
    """A place that would lie beyond the rim of the earth stays where it is."""
    lat_deg, lon_deg = LocalPlane(fix.lat_deg, fix.lon_deg).to_lat_lon_deg(east_m, north_m)
    return fix if math.isnan(lat_deg) else replace(fix, lat_deg=lat_deg, lon_deg=lon_deg)


def _change_of(fault: SensorFault, table: SensorTable, rng: np.random.Generator) -> Change:
    """The change of one fault: those that remember hear every reading, the others those that it covers."""
    match fault.kind:
        case "stuck":
            return _stuck(fault)
        case "delay":
            return _delay(fault)
        case "spike":
            return _while(fault, _spike(fault))
        case "repeat":
            return _while(fault, _repeat(fault))
        case "noise":
            return _while(fault, _noise(fault, table, rng))
        case kind:
            return _while(fault, partial(_ALIKE[kind], fault))


def _while(fault: SensorFault, change: Callable[[Timed], Reading | None]) -> Change:
    """The change while the fault lasts."""

    def apply(timed: Timed) -> Timed | None:
        if not fault.covers(timed.t_s):
            return timed
        reading = change(timed)
        return None if reading is None else replace(timed, reading=reading)

    return apply


def _spike(fault: SensorFault) -> Callable[[Timed], Reading]:
    is_done = False

    def change(timed: Timed) -> Reading:
        nonlocal is_done
        reading = timed.reading if is_done else _step(fault, timed)
        is_done = True
        return reading

    return change


def _repeat(fault: SensorFault) -> Callable[[Timed], Reading]:
    kept: Reading | None = None
    given = 0

    def change(timed: Timed) -> Reading:
        nonlocal kept, given
        if kept is None or given >= fault.size:
            kept, given = timed.reading, 0
        given += 1
        return kept

    return change


def _noise(fault: SensorFault, table: SensorTable, rng: np.random.Generator) -> Callable[[Timed], Reading]:
    if fault.is_factor:
        beyond = math.sqrt(fault.size**2 - 1.0)
        sigmas = {quantity: beyond * sigma for quantity, sigma in _stated_noise(table).items()}
    else:
        sigmas = {fault.quantity: fault.size}
    return lambda timed: _noisy(timed.reading, sigmas, rng)


def _stuck(fault: SensorFault) -> Change:
    """What was given last before the fault; the first reading of the fault where it begins with the voyage."""
    last: Reading | None = None

    def apply(timed: Timed) -> Timed:
        nonlocal last
        if last is None or not fault.covers(timed.t_s):
            last = timed.reading
        return replace(timed, reading=last)

    return apply


def _delay(fault: SensorFault) -> Change:
    """The newest value that is old enough. A receiver's own UTC stays that of the value."""
    past: deque[Timed] = deque()

    def apply(timed: Timed) -> Timed | None:
        past.append(timed)
        while len(past) > 1 and past[1].t_s <= timed.t_s - fault.size:
            past.popleft()
        if not fault.covers(timed.t_s):
            return timed
        old = past[0]
        if old.t_s > timed.t_s - fault.size:
            return None
        reading = old.reading
        if isinstance(reading, FixReading):
            reading = replace(reading, late_s=reading.late_s + timed.t_s - old.t_s)
        return replace(timed, reading=reading)

    return apply


def _stated_noise(table: SensorTable) -> dict[str, float]:
    """1-sigma of each quantity of one reading, as the boat's file states it (m, m/s, deg, deg/s, m/s^2)."""
    per_sample = math.sqrt(table.rate_hz or ROLES[table.role].nominal_rate_hz)
    return {
        PLACE: table.sigma_m,
        VELOCITY: KNOWN_NOISE_M_S,
        HEADING: table.sigma_deg,
        TURN_RATE: table.gyro_density_deg * per_sample,
        ACCELERATION: table.accel_density * per_sample,
    }


def _noisy(reading: Reading, sigmas: dict[str, float], rng: np.random.Generator) -> Reading:
    """Gaussian noise on each quantity; on both axes of a place, a velocity and an acceleration."""
    for quantity, sigma in sigmas.items():
        reading = shifted(reading, quantity, sigma * rng.standard_normal(), 0.0)
        if quantity in (PLACE, VELOCITY):
            reading = shifted(reading, quantity, sigma * rng.standard_normal(), 90.0)
        elif quantity == ACCELERATION and isinstance(reading, ImuReading):
            reading = replace(reading, accel_stb_m_s2=reading.accel_stb_m_s2 + sigma * rng.standard_normal())
    return reading


def _step(fault: SensorFault, timed: Timed) -> Reading:
    return shifted(timed.reading, fault.quantity, fault.size, fault.toward_deg)


def _ramp(fault: SensorFault, timed: Timed) -> Reading:
    return shifted(timed.reading, fault.quantity, fault.size * (timed.t_s - fault.from_s), fault.toward_deg)


def _carry_off(fault: SensorFault, timed: Timed) -> Reading:
    """The place as with a ramp, and the velocity that belongs to it."""
    return shifted(_ramp(fault, timed), VELOCITY, fault.size, fault.toward_deg)


def _dropout(_fault: SensorFault, _timed: Timed) -> None:
    return None


def _zero(_fault: SensorFault, timed: Timed) -> Reading:
    match timed.reading:
        case FixReading() as fix:
            still = None if fix.v_east_m_s is None else 0.0
            return replace(fix, lat_deg=0.0, lon_deg=0.0, v_east_m_s=still, v_north_m_s=still)
        case HeadingReading() as heading:
            return replace(heading, heading_true_deg=0.0)
        case ImuReading() as sample:
            level = None if sample.roll_deg is None else 0.0
            return ImuReading(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, level, level)
        case TurnRateReading():
            return TurnRateReading(0.0)
        case other:
            return other


def _sign(_fault: SensorFault, timed: Timed) -> Reading:
    return _with_angles(timed.reading, lambda heading: wrap_deg(-heading), lambda rate: -rate)


def _unit(_fault: SensorFault, timed: Timed) -> Reading:
    reading = timed.reading
    if isinstance(reading, FixReading) and reading.v_east_m_s is not None and reading.v_north_m_s is not None:
        east, north = reading.v_east_m_s * M_S_PER_KN, reading.v_north_m_s * M_S_PER_KN
        return replace(reading, v_east_m_s=east, v_north_m_s=north)
    return _with_angles(reading, math.radians, math.radians)


def _with_angles(reading: Reading, heading: Callable[[float], float], rate: Callable[[float], float]) -> Reading:
    """A reading whose heading (deg), or yaw rate (deg/s), goes through a function."""
    match reading:
        case HeadingReading():
            return replace(reading, heading_true_deg=heading(reading.heading_true_deg))
        case ImuReading():
            return replace(reading, yaw_rate_deg_s=rate(reading.yaw_rate_deg_s))
        case TurnRateReading():
            return TurnRateReading(rate(reading.rate_deg_s))
        case _:
            return reading


def _turned(fault: SensorFault, timed: Timed) -> Reading:
    sample = timed.reading
    if not isinstance(sample, ImuReading):
        return sample
    cosine, sine = math.cos(math.radians(fault.size)), math.sin(math.radians(fault.size))
    fwd, stb = sample.accel_fwd_m_s2, sample.accel_stb_m_s2
    return replace(sample, accel_fwd_m_s2=cosine * fwd + sine * stb, accel_stb_m_s2=cosine * stb - sine * fwd)


def _upside_down(_fault: SensorFault, timed: Timed) -> Reading:
    sample = timed.reading
    if not isinstance(sample, ImuReading):
        return sample
    return replace(
        sample,
        accel_stb_m_s2=-sample.accel_stb_m_s2,
        accel_down_m_s2=-sample.accel_down_m_s2,
        pitch_rate_deg_s=-sample.pitch_rate_deg_s,
        yaw_rate_deg_s=-sample.yaw_rate_deg_s,
    )


def _clock(fault: SensorFault, timed: Timed) -> Reading:
    fix = timed.reading
    return replace(fix, late_s=fix.late_s - fault.size) if isinstance(fix, FixReading) else fix


def _claim(fault: SensorFault, timed: Timed) -> Reading:
    fix = timed.reading
    return replace(fix, quality=int(fault.size)) if isinstance(fix, FixReading) else fix


_ALIKE: Final[dict[str, Callable[[SensorFault, Timed], Reading | None]]] = {
    "step": _step,
    "ramp": _ramp,
    "carry-off": _carry_off,
    "dropout": _dropout,
    "zero": _zero,
    "sign": _sign,
    "unit": _unit,
    "turned": _turned,
    "upside-down": _upside_down,
    "clock": _clock,
    "claim": _claim,
}
"""Kinds that do the same with each reading, whatever was before."""
