"""Fault injection: what a broken, wrongly mounted or disturbed sensor gives instead of its readings.

A fault is a function from reading to reading that keeps what it must remember. It knows neither truth nor filter, so
the same sentence (`fault_text.py`) spoils the readings of a virtual boat and those of a log.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Final

import numpy as np

from common.angles import wrap_deg
from common.boat_config import ROLES, BoatConfig, SensorTable
from common.geodesy import LocalPlane
from common.simulation.fault_text import ACCELERATION, HEADING, PLACE, TURN_RATE, VELOCITY, SensorFault, fault_of
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Reading, Timed, TurnRateReading
from common.simulation.voyage import Voyage
from common.units import M_S_PER_KN

Change = Callable[[Timed], Timed | None]
"""What becomes of a reading while the fault lasts; `None` = nothing comes. Called for every reading of the sensor, in
order of time, also before and after."""

KNOWN_NOISE_M_S: Final = 0.1
"""1-sigma on an axis of a receiver's velocity, m/s, for `noise xN`: the boat's file does not state it."""


class Faults:
    """All faults of a boat, applied to one reading after the other."""

    def __init__(self, faults: Sequence[SensorFault], sensors: Iterable[SensorTable], seed: int = 1) -> None:
        """seed: of the noise that faults add."""
        tables = {sensor.id: sensor for sensor in sensors}
        self._changes: dict[str, list[Change]] = {}
        for index, fault in enumerate(faults):
            rng = np.random.default_rng((seed, index))
            change = _MAKERS[fault.kind](fault, tables[fault.sensor], rng)
            self._changes.setdefault(fault.sensor, []).append(change)

    def spoil(self, timed: Timed) -> Timed | None:
        """What the sensor gives instead; faults of one sensor apply in the order in which they were named."""
        for change in self._changes.get(timed.sensor, ()):
            spoilt = change(timed)
            if spoilt is None:
                return None
            timed = spoilt
        return timed


def faults_of(texts: Sequence[str], config: BoatConfig, where: str = "--inject") -> tuple[SensorFault, ...]:
    """The faults that sentences name; raises WayfixError for one that does not fit the boat."""
    roles = {sensor.id: sensor.role for sensor in config.sensor}
    return tuple(fault_of(text, roles, where) for text in texts)


def with_faults(voyage: Voyage, texts: Sequence[str], seed: int = 1, where: str = "--inject") -> Voyage:
    """The voyage with faults in its readings."""
    if not texts:
        return voyage
    faults = Faults(faults_of(texts, voyage.config, where), voyage.config.sensor, seed)
    spoilt = [timed for each in voyage.readings if (timed := faults.spoil(each)) is not None]
    return replace(voyage, readings=tuple(sorted(spoilt, key=attrgetter("t_s"))))


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


def _while(fault: SensorFault, change: Callable[[Timed], Reading | None]) -> Change:
    """A change that remembers nothing, while the fault lasts."""

    def apply(timed: Timed) -> Timed | None:
        if not fault.covers(timed.t_s):
            return timed
        reading = change(timed)
        return None if reading is None else replace(timed, reading=reading)

    return apply


def _spike(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    done = False

    def change(timed: Timed) -> Reading:
        nonlocal done
        if done:
            return timed.reading
        done = True
        return shifted(timed.reading, fault.quantity, fault.size, fault.toward_deg)

    return _while(fault, change)


def _step(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    return _while(fault, lambda timed: shifted(timed.reading, fault.quantity, fault.size, fault.toward_deg))


def _ramp(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
        amount = fault.size * (timed.t_s - fault.from_s)
        return shifted(timed.reading, fault.quantity, amount, fault.toward_deg)

    return _while(fault, change)


def _carry_off(fault: SensorFault, table: SensorTable, rng: np.random.Generator) -> Change:
    """The place as with a ramp, and the velocity that belongs to it."""
    ramp = _ramp(fault, table, rng)

    def apply(timed: Timed) -> Timed | None:
        drifted = ramp(timed)
        if drifted is None or not fault.covers(timed.t_s):
            return drifted
        return replace(drifted, reading=shifted(drifted.reading, VELOCITY, fault.size, fault.toward_deg))

    return apply


def _noise(fault: SensorFault, table: SensorTable, rng: np.random.Generator) -> Change:
    beyond = math.sqrt(max(fault.size**2 - 1.0, 0.0))
    stated = _stated_noise(table)

    def change(timed: Timed) -> Reading:
        if not fault.is_factor:
            return _noisy(timed.reading, {fault.quantity: fault.size}, rng)
        return _noisy(timed.reading, {quantity: beyond * sigma for quantity, sigma in stated.items()}, rng)

    return _while(fault, change)


def _stated_noise(table: SensorTable) -> dict[str, float]:
    """1-sigma of each quantity of one reading, as the boat's file states it (m, m/s, deg, deg/s, m/s^2)."""
    rate_hz = table.rate_hz or ROLES[table.role].nominal_rate_hz
    per_sample = math.sqrt(rate_hz)
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
        if quantity in (PLACE, VELOCITY):
            reading = shifted(reading, quantity, sigma * rng.standard_normal(), 0.0)
            reading = shifted(reading, quantity, sigma * rng.standard_normal(), 90.0)
        else:
            reading = shifted(reading, quantity, sigma * rng.standard_normal(), 0.0)
        if quantity == ACCELERATION and isinstance(reading, ImuReading):
            reading = replace(reading, accel_stb_m_s2=reading.accel_stb_m_s2 + sigma * rng.standard_normal())
    return reading


def _stuck(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    """What was given last before the fault; the first reading of the fault where it begins with the voyage."""
    last: Reading | None = None

    def apply(timed: Timed) -> Timed:
        nonlocal last
        if last is None or not fault.covers(timed.t_s):
            last = timed.reading
        return replace(timed, reading=last)

    return apply


def _repeat(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    kept: Reading | None = None
    given = 0

    def change(timed: Timed) -> Reading:
        nonlocal kept, given
        if kept is None or given >= fault.size:
            kept, given = timed.reading, 0
        given += 1
        return kept

    return _while(fault, change)


def _delay(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
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


def _zero(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
        match timed.reading:
            case FixReading() as fix:
                still = None if fix.v_east_m_s is None else 0.0
                return replace(fix, lat_deg=0.0, lon_deg=0.0, v_east_m_s=still, v_north_m_s=still)
            case HeadingReading() as heading:
                return replace(heading, heading_true_deg=0.0)
            case ImuReading() as sample:
                return ImuReading(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, sample.roll_deg, sample.pitch_deg)
            case TurnRateReading():
                return TurnRateReading(0.0)
            case other:
                return other

    return _while(fault, change)


def _sign(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
        match timed.reading:
            case HeadingReading() as heading:
                return replace(heading, heading_true_deg=wrap_deg(-heading.heading_true_deg))
            case ImuReading() as sample:
                return replace(sample, yaw_rate_deg_s=-sample.yaw_rate_deg_s)
            case TurnRateReading() as rate:
                return TurnRateReading(-rate.rate_deg_s)
            case other:
                return other

    return _while(fault, change)


def _unit(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
        match timed.reading:
            case HeadingReading() as heading:
                return replace(heading, heading_true_deg=math.radians(heading.heading_true_deg))
            case ImuReading() as sample:
                return replace(sample, yaw_rate_deg_s=math.radians(sample.yaw_rate_deg_s))
            case TurnRateReading() as rate:
                return TurnRateReading(math.radians(rate.rate_deg_s))
            case FixReading(v_east_m_s=float() as east, v_north_m_s=float() as north) as fix:
                return replace(fix, v_east_m_s=east * M_S_PER_KN, v_north_m_s=north * M_S_PER_KN)
            case other:
                return other

    return _while(fault, change)


def _turned(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    cosine, sine = math.cos(math.radians(fault.size)), math.sin(math.radians(fault.size))

    def change(timed: Timed) -> Reading:
        sample = timed.reading
        if not isinstance(sample, ImuReading):
            return sample
        fwd, stb = sample.accel_fwd_m_s2, sample.accel_stb_m_s2
        return replace(sample, accel_fwd_m_s2=cosine * fwd + sine * stb, accel_stb_m_s2=cosine * stb - sine * fwd)

    return _while(fault, change)


def _upside_down(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
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

    return _while(fault, change)


def _dropout(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    return _while(fault, lambda _timed: None)


def _clock(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
        fix = timed.reading
        return replace(fix, late_s=fix.late_s - fault.size) if isinstance(fix, FixReading) else fix

    return _while(fault, change)


def _claim(fault: SensorFault, _table: SensorTable, _rng: np.random.Generator) -> Change:
    def change(timed: Timed) -> Reading:
        fix = timed.reading
        return replace(fix, quality=int(fault.size)) if isinstance(fix, FixReading) else fix

    return _while(fault, change)


_MAKERS: Final[dict[str, Callable[[SensorFault, SensorTable, np.random.Generator], Change]]] = {
    "spike": _spike,
    "step": _step,
    "ramp": _ramp,
    "carry-off": _carry_off,
    "noise": _noise,
    "stuck": _stuck,
    "repeat": _repeat,
    "zero": _zero,
    "dropout": _dropout,
    "delay": _delay,
    "clock": _clock,
    "claim": _claim,
    "sign": _sign,
    "unit": _unit,
    "turned": _turned,
    "upside-down": _upside_down,
}
