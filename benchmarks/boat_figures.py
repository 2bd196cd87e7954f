"""Figures of a boat and its sensors (autocorrelation, gravity in turns, spectra), the same for any origin.

A `Boat` is a recording or a simulated boat; a figure is NaN where the boat has not what it needs. Times are s, places
east and north m, angles rad, body axes forward and starboard.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Track:
    """What a receiver told at its epochs: places (n, 2) m, velocities (n, 2) m/s (NaN = none told), heading rad."""

    t_s: Array
    place_m: Array
    velocity_m_s: Array
    heading_rad: Array

    @property
    def step_s(self) -> float:
        """Time between two epochs."""
        return float(np.median(np.diff(self.t_s)))


@dataclass(frozen=True, slots=True)
class Body:
    """Columns at 10 Hz: velocity forward and to starboard, yaw rate, accelerometers."""

    u: Array
    v: Array
    rate: Array
    accel_fwd: Array
    accel_stb: Array


@dataclass(frozen=True, slots=True)
class Boat:
    """What is known of one boat."""

    track: Track | None = None
    error_m: Array | None = None
    """Error of the places (n, 2) against the truth."""
    velocity_error_m_s: Array | None = None
    """Error of the told velocity (n, 2) against the truth."""
    compass_error_rad: Array | None = None
    body: Body | None = None
    tilt_rad: Array | None = None
    """Roll and pitch (n, 2)."""
    tilt_step_s: float = 0.05


def wander_correlation(boat: Boat, lag_s: float) -> float:
    """Autocorrelation of the places of a still boat about their mean over the first 570 s; errors where known."""
    if boat.track is None:
        return np.nan
    places = boat.track.place_m if boat.error_m is None else boat.error_m
    first = places[boat.track.t_s < boat.track.t_s[0] + 570.0]
    return _autocorrelation(first - first.mean(axis=0), round(lag_s / boat.track.step_s))


def error_correlation(boat: Boat, lag_s: float) -> float:
    """Autocorrelation of the errors against the truth."""
    if boat.track is None or boat.error_m is None:
        return np.nan
    return _autocorrelation(boat.error_m, round(lag_s / boat.track.step_s))


def _autocorrelation(errors: Array, lag: int) -> float:
    if 3 * lag > 2 * len(errors):
        return np.nan
    return float((errors[: len(errors) - lag] * errors[lag:]).mean() / (errors**2).mean())


def wander_m(boat: Boat) -> float:
    """1-sigma on an axis about the mean of 570 s."""
    if boat.track is None:
        return np.nan
    places = boat.track.place_m if boat.error_m is None else boat.error_m
    return float(places[boat.track.t_s < boat.track.t_s[0] + 570.0].std(axis=0).mean())


def told_velocity(boat: Boat) -> float:
    """1-sigma on an axis of SOG and COG against places differentiated over 0.4 s; epochs beside a hole are left out."""
    if boat.track is None:
        return np.nan
    t_s, apart = boat.track.t_s, round(0.2 / boat.track.step_s)
    span_s = t_s[2 * apart :] - t_s[: -2 * apart]
    moved = (boat.track.place_m[2 * apart :] - boat.track.place_m[: -2 * apart]) / span_s[:, np.newaxis]
    off = boat.track.velocity_m_s[apart:-apart] - moved
    whole = np.isfinite(off).all(axis=1) & (np.abs(span_s - 0.4) < 0.01)
    return float(np.sqrt((off[whole] ** 2).mean()))


def true_velocity(boat: Boat) -> float:
    """1-sigma on an axis of SOG and COG against the truth."""
    return np.nan if boat.velocity_error_m_s is None else float(np.sqrt(np.nanmean(boat.velocity_error_m_s**2)))


def seaway_m_s(boat: Boat) -> float:
    """1-sigma on an axis of the told velocity about its mean of 5 s."""
    if boat.track is None:
        return np.nan
    told = boat.track.velocity_m_s[np.isfinite(boat.track.velocity_m_s).all(axis=1)]
    steps = round(5.0 / boat.track.step_s) | 1
    return float(np.mean([_about_mean(told[:, axis], steps).std() for axis in range(2)]))


def seaway_deg(boat: Boat) -> float:
    """1-sigma of the heading about its mean of 5 s."""
    if boat.track is None:
        return np.nan
    return float(np.degrees(_about_mean(boat.track.heading_rad, round(5.0 / boat.track.step_s) | 1).std()))


def drift_angle_deg(boat: Boat) -> float:
    """1-sigma (by the median) of the course over ground about the heading, above 0.5 m/s and on straight legs.

    Course over 6 s; a leg is straight where the heading changes by less than 10 deg in them. An offset of the heading
    does not count.
    """
    if boat.track is None:
        return np.nan
    rows = round(6.0 / boat.track.step_s)
    heading, place_m, t_s = boat.track.heading_rad, boat.track.place_m, boat.track.t_s
    moved = (place_m[rows:] - place_m[:-rows]) / (t_s[rows:] - t_s[:-rows])[:, np.newaxis]
    turned = np.abs(np.angle(np.exp(1j * (heading[rows:] - heading[:-rows]))))
    use = (np.hypot(moved[:, 0], moved[:, 1]) > 0.5) & (turned < np.radians(10.0))
    if use.sum() < 50:
        return np.nan
    off = np.exp(1j * (np.arctan2(moved[use, 0], moved[use, 1]) - heading[rows // 2 :][: len(use)][use]))
    angles = np.degrees(np.angle(off * np.conj(off.mean())))
    return float(1.4826 * np.median(np.abs(angles - np.median(angles))))


def compass_error_deg(boat: Boat) -> float:
    """RMS of the compass' error over the headings that the boat sailed."""
    return np.nan if boat.compass_error_rad is None else float(np.degrees(np.sqrt((boat.compass_error_rad**2).mean())))


def gravity_in_turns(boat: Boat) -> float:
    """Slope of the starboard accelerometer on u r, beside dv/dt and a constant: 1 = no heel, 1 + g h with heel."""
    if boat.body is None:
        return np.nan
    body = boat.body
    columns = (body.u * body.rate, np.gradient(body.v, 0.1), np.ones_like(body.u))
    rows = np.stack([_smooth(column, 10) for column in columns], axis=1)
    return float(np.linalg.lstsq(rows, _smooth(body.accel_stb, 10), rcond=None)[0][0])


def gravity_of_trim(boat: Boat) -> float:
    """Slope of the forward accelerometer, less what the motion explains, on u |u|, m/s^2 per (m/s)^2."""
    if boat.body is None:
        return np.nan
    body = boat.body
    left = _smooth(body.accel_fwd - np.gradient(body.u, 0.1) + body.rate * body.v, 10)
    return float(np.polyfit(_smooth(body.u * np.abs(body.u), 10), left, 1)[0])


def unexplained_m_s2(boat: Boat) -> float:
    """1-sigma of the starboard accelerometer less dv/dt + u r, sample by sample at 10 Hz."""
    if boat.body is None:
        return np.nan
    body = boat.body
    return float((body.accel_stb - np.gradient(body.v, 0.1) - body.u * body.rate).std())


def outward_slide_s(boat: Boat) -> float:
    """Factor k of the outward slide v = -k u r, s."""
    if boat.body is None:
        return np.nan
    body = boat.body
    return -float(np.polyfit(_smooth(body.u * body.rate, 10), _smooth(body.v, 10), 1)[0])


def tilt_deg(boat: Boat, axis: int) -> float:
    """1-sigma of roll (0) or pitch (1) about its mean of 10 s."""
    if boat.tilt_rad is None:
        return np.nan
    return float(np.degrees(_about_mean(boat.tilt_rad[:, axis], round(10.0 / boat.tilt_step_s) | 1).std()))


def tilt_hz(boat: Boat, axis: int) -> float:
    """Frequency of the largest line above 0.08 Hz in the spectrum of roll or pitch (Hann window)."""
    if boat.tilt_rad is None or boat.tilt_step_s > 0.5:
        return np.nan
    values = boat.tilt_rad[:, axis] - boat.tilt_rad[:, axis].mean()
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
    hz = np.fft.rfftfreq(len(values), boat.tilt_step_s)
    power[hz < 0.08] = 0.0
    return float(hz[int(power.argmax())])


def _smooth(values: Array, steps: int) -> Array:
    return np.convolve(values, np.ones(steps) / steps, "valid")


def _about_mean(values: Array, steps: int) -> Array:
    return values[steps // 2 : len(values) - steps // 2] - _smooth(values, steps)
