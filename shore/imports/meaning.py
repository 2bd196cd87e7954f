"""Plausibility check of units and signs: what several sensors say of one motion must agree (cross-sensor consistency).

Compared are changes between neighbouring windows of `WINDOW_S`, so that constant biases fall out and noise is averaged:
the heading's with the integral of the yaw rate, the speed's with that of the forward acceleration. The speed and course
of the places are compared with the speed and heading that are given. A factor near 57.3, 9.8, 1.94 or -1 is a unit or a
sign.
"""

from itertools import chain
from math import degrees
from typing import Final, NamedTuple

import numpy as np

from common.framer import ImuSample, Measurement
from common.geodesy import LocalPlane
from common.messages import Fix, Frame, Heading, TurnRate
from common.simulation.column_map import ColumnMap
from common.units import M_S_PER_KN, NS_PER_S, STANDARD_GRAVITY_M_S2
from shore.imports.window_means import LEAST_WINDOWS, MOST_WINDOWS, WINDOW_S, Array, Series, WindowMeans, factor_between

LEAST_SHARE: Final = 0.6
"""Least share of the changes that one factor must explain (r^2)."""
UNRELATED: Final = 0.3
"""A heading that explains less than this share of the changes of course is no heading."""
FAST_M_S: Final = 3.0
"""Median speed below which the noise of the places makes the course uncertain, so that no heading is judged by it."""
NEAR: Final = 1.3
"""A factor counts as one of the candidates when it lies within this ratio of it."""
_RAD: Final = degrees(1.0)
_G: Final = STANDARD_GRAVITY_M_S2
_KN: Final = 1.0 / M_S_PER_KN


class Cause(NamedTuple):
    """A factor that is no chance."""

    factor: float
    guess: str


_RIGHT: Final = Cause(1.0, "they agree")
_YAW_RATE: Final = (
    Cause(_RAD, "is it in rad/s?"),
    Cause(1.0 / _RAD, "was it turned into degrees twice?"),
    Cause(1.0 / 60.0, "is it in deg/min?"),
    Cause(-1.0, "does its axis point up, or is the box upside down?"),
    Cause(-_RAD, "is it in rad/s, with an axis that points up?"),
    Cause(-1.0 / 60.0, "is it in deg/min, with an axis that points up?"),
)
_ACCELERATION: Final = (
    Cause(_G, "is it in g?"),
    Cause(1.0 / _G, "was it turned from g into m/s^2 twice?"),
    Cause(-1.0, "does its axis point the other way?"),
    Cause(-_G, "is it in g, with an axis that points the other way?"),
)
_SPEED: Final = (
    Cause(_KN, "is it in m/s?"),
    Cause(1.0 / 1.852, "is it in km/h?"),
    Cause(_KN / 100.0, "is it in cm/s?"),
    Cause(M_S_PER_KN, "was it turned into knots twice?"),
    Cause(1609.344 / 1852.0, "is it in mph?"),
)
SWAPPED: Final = "lat and lon"
LON_SIGN: Final = "lon"
LAT_SIGN: Final = "lat"
MIRRORED: Final = (SWAPPED, LON_SIGN, LAT_SIGN)
"""Keys of doubts of a mirrored map."""
_MIRRORS: Final = (
    (90.0, SWAPPED, "are latitude and longitude swapped?"),
    (0.0, LON_SIGN, "has the longitude the wrong sign (W is negative)?"),
    (180.0, LAT_SIGN, "has the latitude the wrong sign (S is negative)?"),
)
"""Sum of true and mirrored course, deg."""
FAR_OFF_DEG: Final = 45.0
NEAR_DEG: Final = 20.0
AGREED_DEG: Final = 10.0
"""Two courses over ground that agree so far are not doubted, whatever a mirrored map would give."""
_HEADING: Final = (
    Cause(_RAD, "is it in radians?"),
    Cause(-1.0, "does it count anticlockwise, from east, or has lat or lon the wrong sign?"),
)
BACK_DEG: Final = 180.0
_BOWS: Final = (
    (_RAD, 0.0, "is it in radians?"),
    (-1.0, 90.0, "does it count anticlockwise, from east?"),
    (-_RAD, 90.0, "is it in radians, anticlockwise from east?"),
    (1.0, BACK_DEG, "is it mounted backwards, or does the boat go astern?"),
)
"""Factor and offset, deg, that make a course of a heading."""


class Doubt(NamedTuple):
    """A quantity that others contradict, or agree with."""

    text: str
    """What contradicts what, in figures, and a guess why."""
    key: str
    """Key of a mapping that cures it."""
    factor: float | None
    """Factor by which the quantity must be multiplied, 1 = it agrees with the others; `None` = no factor cures it."""


class MeaningCheck:
    """Gathers what frames say of the motion: of each quantity the first sensor that speaks of it."""

    def __init__(self) -> None:
        self._series: dict[str, Series] = {}
        self._sensor: dict[str, str] = {}
        self._plane: LocalPlane | None = None

    def take(self, frame: Frame) -> None:
        """The measurements of one frame."""
        for measurement in chain[Measurement](frame.fixes, frame.headings, frame.turn_rates):
            self.add(measurement)
        for block in frame.imu:
            for t_ns, *values in zip(
                block.sample_t_ns, block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s, strict=True
            ):
                self.add(ImuSample(block.sensor, t_ns, *values))

    def add(self, measurement: Measurement) -> None:
        """One measurement; of what says nothing of the motion nothing is taken."""
        sensor, t_ns = measurement.sensor, measurement.t_ns
        if isinstance(measurement, Fix) and measurement.usable:
            self._take_fix(measurement)
        elif isinstance(measurement, Heading):
            true_deg, mag_deg = measurement.heading_true_deg, measurement.heading_mag_deg
            self._add("heading", sensor, t_ns, mag_deg if true_deg is None else true_deg)
        elif isinstance(measurement, TurnRate):
            self._add("yaw_rate", sensor, t_ns, measurement.rate_deg_s)
        elif isinstance(measurement, ImuSample):
            self._add("accel_fwd", sensor, t_ns, measurement.accel_fwd_m_s2)
            self._add("accel_stb", sensor, t_ns, measurement.accel_stb_m_s2)
            self._add("yaw_rate", sensor, t_ns, measurement.yaw_rate_deg_s)

    def doubts(self) -> list[Doubt]:
        """What contradicts what; empty where nothing does, or where too little moved to tell."""
        return [found for found in self.findings() if found.factor != 1.0]

    def findings(self) -> list[Doubt]:
        """The same, and what agrees."""
        starts = [series.t_ns[0] for series in self._series.values()]
        ends = [series.t_ns[-1] for series in self._series.values()]
        if not starts or not LEAST_WINDOWS <= (max(ends) - min(starts)) / NS_PER_S / WINDOW_S <= MOST_WINDOWS:
            return []
        means = WindowMeans(self._series, min(starts), max(ends))
        turn = _yaw_rate_doubt(means)
        is_turned = turn is not None and turn.factor is not None and turn.factor < 0.0
        found = [
            _heading_doubt(means) or _bow_doubt(means),
            turn,
            _forward_doubt(means),
            _starboard_doubt(means, is_turned=is_turned),
        ]
        found.append(_speed_doubt(means))
        if (mirrored := _mirror_doubt(means)) is not None:
            found[0] = mirrored  # by such places no heading can be judged
        found += [_axis_doubt(self._series, name) for name in ("accel_fwd", "accel_stb", "yaw_rate")]
        return [doubt for doubt in found if doubt is not None]

    def _take_fix(self, fix: Fix) -> None:
        if fix.lat_deg is None or fix.lon_deg is None:
            return
        if self._plane is None:
            self._plane = LocalPlane(fix.lat_deg, fix.lon_deg)
        east_m, north_m = self._plane.to_east_north_m(fix.lat_deg, fix.lon_deg)
        self._add("east", fix.sensor, fix.t_ns, east_m)
        self._add("north", fix.sensor, fix.t_ns, north_m)
        self._add("sog", fix.sensor, fix.t_ns, fix.sog_kn)
        self._add("cog", fix.sensor, fix.t_ns, fix.cog_true_deg)

    def _add(self, name: str, sensor: str, t_ns: int, value: float | None) -> None:
        if value is not None and self._sensor.setdefault(name, sensor) == sensor:
            self._series.setdefault(name, Series()).add(t_ns, value)


def _cause(factor: float, causes: tuple[Cause, ...], near: float = NEAR) -> Cause | None:
    """The candidate next to a factor, by ratio; `None` = none is near."""
    alike = [cause for cause in (_RIGHT, *causes) if 1.0 / near < factor / cause.factor < near]
    return min(alike, key=lambda cause: abs(np.log(factor / cause.factor)), default=None)


def _yaw_rate_doubt(means: WindowMeans) -> Doubt | None:
    """Against the heading, or where there is none against the course of the places."""
    fit = factor_between(means.changes("heading"), means.changes("sum of yaw_rate"), 2.0)
    name = "heading"
    if "heading" not in means.of:
        fit, name = factor_between(*_beside_course(means, "sum of yaw_rate"), 5.0), "course"
    cause = None if fit is None or fit.share < LEAST_SHARE else _cause(fit.factor, _YAW_RATE)
    if fit is None or cause is None:
        return None
    turned, summed = fit.longest
    text = f"the {name} turned {turned:.0f} deg where the yaw rate integrates to {summed:.2g}: {cause.guess}"
    return Doubt(text, "yaw_rate_scale", cause.factor)


def _forward_doubt(means: WindowMeans) -> Doubt | None:
    speed = means.changes("sog")
    fit = factor_between(None if speed is None else speed * M_S_PER_KN, means.changes("sum of accel_fwd"), 0.3)
    cause = None if fit is None or fit.share < LEAST_SHARE else _cause(fit.factor, _ACCELERATION)
    if fit is None or cause is None:
        return None
    gained, summed = fit.longest
    text = f"the speed changed by {gained:.1f} m/s where accel_fwd integrates to {summed:.2g}: {cause.guess}"
    return Doubt(text, "accel_scale", cause.factor)


def _starboard_doubt(means: WindowMeans, *, is_turned: bool) -> Doubt | None:
    """Centripetal acceleration: speed times turn.

    A hull that heels hides or reverses it at low speed, so a wrong sign is believed of a box whose yaw rate has it too.
    """
    turn, speed = means.changes("heading"), means.of.get("sog")
    if speed is None and hasattr(means, "v_east"):
        speed = np.append(np.hypot(means.v_east, means.v_north), np.nan) / M_S_PER_KN
    if turn is None or speed is None:
        return None
    sideways = np.radians(turn) * (speed[1:] + speed[:-1]) / 2.0 * M_S_PER_KN
    fit = factor_between(sideways, means.changes("sum of accel_stb"), 0.1)
    cause = None if fit is None or fit.share < LEAST_SHARE else _cause(fit.factor, _ACCELERATION)
    if fit is None or cause is None or (cause.factor < 0.0 and not is_turned):
        return None
    text = (
        f"turns call for {fit.longest[0]:.1f} m/s to starboard where accel_stb integrates to {fit.longest[1]:.2g}: "
        f"{cause.guess}"
    )
    return Doubt(text, "accel_stb_scale", cause.factor)


def _speed_doubt(means: WindowMeans) -> Doubt | None:
    if "sog" not in means.of or not hasattr(means, "v_east"):
        return None
    moved = np.hypot(means.v_east, means.v_north) / M_S_PER_KN
    said = (means.of["sog"][1:] + means.of["sog"][:-1]) / 2.0
    fast = np.isfinite(moved) & np.isfinite(said) & (moved > 2.0) & (said > 0.01)
    if fast.sum() < LEAST_WINDOWS:
        return None
    low, factor, high = np.quantile(moved[fast] / said[fast], (0.25, 0.5, 0.75))
    cause = _cause(float(factor), _SPEED, 1.06) if high < 1.15 * low else None
    if cause is None:
        return None
    text = (
        f"the places move at {np.median(moved[fast]):.1f} kn where the speed says {np.median(said[fast]):.1f}: "
        f"{cause.guess}"
    )
    return Doubt(text, "sog_scale", cause.factor)


def _heading_doubt(means: WindowMeans) -> Doubt | None:
    """Heading against the course of the places: leeway and current are small beside a wrong unit."""
    fit = factor_between(*_beside_course(means, "heading"), 5.0)
    if fit is None:
        return None
    turned, said = fit.longest
    text = f"the course turned {turned:.0f} deg where the heading turned {said:.2g}"
    cause = None if fit.share < LEAST_SHARE else _cause(fit.factor, _HEADING)
    if cause is not None:
        return Doubt(f"{text}: {cause.guess}", "scale", cause.factor)
    is_fast = np.nanmedian(np.hypot(means.v_east, means.v_north)) > FAST_M_S
    if is_fast and not UNRELATED < fit.share < LEAST_SHARE:
        return Doubt(f"{text}: is it the direction of the bow?", "heading", None)
    return None


def _bow_doubt(means: WindowMeans) -> Doubt | None:
    """Heading beside the course of the places themselves, on a straight way too."""
    course, said = _courses(means, "heading")
    off_deg = _off(said - course)
    if off_deg < NEAR_DEG:
        return None
    text = f"the places move to {course[0] % 360:.0f} deg where the heading says {said[0]:.3g}"
    for factor, offset_deg, guess in _BOWS:
        if _off(factor * said + offset_deg - course) < min(NEAR_DEG, off_deg / 3.0):
            return Doubt(f"{text}: {guess}", "heading" if offset_deg == BACK_DEG else "scale",
                         None if offset_deg == BACK_DEG else factor)  # fmt: skip
    return None if off_deg < FAR_OFF_DEG else Doubt(f"{text}: is it the direction of the bow?", "heading", None)


def _beside_course(means: WindowMeans, name: str) -> tuple[Array | None, Array | None]:
    """Changes of the course of the places, deg, and of a quantity beside them; only at 1 m/s and more."""
    if name not in means.of or not hasattr(means, "v_east"):
        return None, None
    course = np.degrees(np.arctan2(means.v_east, means.v_north))
    values = (means.of[name][1:] + means.of[name][:-1]) / 2.0
    good = np.isfinite(course) & np.isfinite(values) & (np.hypot(means.v_east, means.v_north) > 1.0)
    if good.sum() < 2 * LEAST_WINDOWS:
        return None, None
    turned = np.degrees(np.unwrap(np.radians(course[good])))
    beside = np.diff(np.flatnonzero(good)) == 1
    return np.diff(turned)[beside], np.diff(values[good])[beside]


def _mirror_doubt(means: WindowMeans) -> Doubt | None:
    """Course of the places against the receiver's own: a sum of both that stays is a mirrored map."""
    course, said = _courses(means, "cog")
    off_deg = _off(course - said)
    if off_deg < AGREED_DEG:
        return None
    for whole_deg, key, guess in _MIRRORS:
        if _off(course + said - whole_deg) < min(NEAR_DEG, off_deg / 3.0):
            text = f"the places move to {course[0] % 360:.0f} deg where the course says {said[0] % 360:.0f}"
            return Doubt(f"{text}: {guess}", key, None)
    return None


def _courses(means: WindowMeans, name: str) -> tuple[Array, Array]:
    """Course of the places at 1 m/s and more, deg, and a direction beside it; none where too few windows have both."""
    if name not in means.of or not hasattr(means, "v_east"):
        return np.zeros(0), np.zeros(0)
    course = np.degrees(np.arctan2(means.v_east, means.v_north))
    said = (means.of[name][1:] + means.of[name][:-1]) / 2.0
    good = np.isfinite(course) & np.isfinite(said) & (np.hypot(means.v_east, means.v_north) > 1.0)
    few = good.sum() < LEAST_WINDOWS
    return course[good & ~few], said[good & ~few]


def _off(angles_deg: Array) -> float:
    """Median size of angles, deg; 0 of none."""
    if not len(angles_deg):
        return 0.0
    return float(np.median(np.abs((angles_deg + 180.0) % 360.0 - 180.0)))


def _axis_doubt(series: dict[str, Series], name: str) -> Doubt | None:
    """An axis that shows gravity all the time is the vertical one; one that never changes is no sensor."""
    values = np.asarray(series[name].value) if name in series else np.zeros(0)
    if len(values) < LEAST_WINDOWS:
        return None
    mean, spread = float(np.mean(values)), float(np.std(values))
    if spread == 0.0:
        return Doubt(f"{name} is {mean:g} in all {len(values)} samples: does that sensor work?", name, None)
    for gravity in () if name == "yaw_rate" else (_G, 1.0):
        if abs(abs(mean) - gravity) < 0.05 * gravity and spread < 0.2 * gravity:
            return Doubt(f"{name} is {mean:.2f} all the time, as gravity is: is it the vertical axis?", name, None)
    return None


def words_of(doubt: Doubt, mapping: ColumnMap | None) -> str:
    """A doubt as a sentence, with the line of the mapping that cures it; `None` = no mapping was used."""
    if mapping is None:
        return doubt.text if doubt.factor is None else f"{doubt.text} (a factor of {doubt.factor:.7g})"
    return f"{doubt.text} Cure: {_cure(doubt, mapping)}"


def _cure(doubt: Doubt, mapping: ColumnMap) -> str:
    if doubt.key in MIRRORED:
        return "correct lat and lon of [fix]"
    if doubt.factor is None:
        return f"give {doubt.key} the right column, or leave it out"
    return ", ".join(f"{key} = {value:.7g}" for key, value in cured(doubt, mapping).items())


def cured(doubt: Doubt, mapping: ColumnMap) -> dict[str, float]:
    """The keys of a mapping that must change, and their new values; the doubt must have a factor."""
    fix, heading, imu = mapping.fix, mapping.heading, mapping.imu
    assert doubt.factor is not None
    fwd = 1.0 if imu is None or imu.accel_scale is None else imu.accel_scale
    stb = fwd if imu is None or imu.accel_stb_scale is None else imu.accel_stb_scale
    match doubt.key:
        case "accel_scale" if doubt.factor < 0.0:  # the sign is that of one axis, the unit that of both
            return {"accel_scale": fwd * doubt.factor, "accel_stb_scale": stb * abs(doubt.factor)}
        case "accel_scale":
            now: float | None = fwd
        case "accel_stb_scale":
            now = stb
        case "yaw_rate_scale":
            now = None if imu is None else imu.yaw_rate_scale
        case "sog_scale":
            now = None if fix is None else fix.sog_scale
        case _:
            now = None if heading is None else heading.scale
    value = doubt.factor * (1.0 if now is None else now)
    turned = {"offset_deg": 90.0} if doubt.key == "scale" and doubt.factor < 0.0 else {}
    return {doubt.key: value, **turned}
