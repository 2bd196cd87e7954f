"""GNSS error model of a real receiver: Gauss-Markov position error, fix quality, DOP, smoothed and frozen velocity.

What is drawn for each receiver, and where its size comes from:

* Position error an axis: `UERE_M` of the quality times HDOP. A part lasts 20 to 600 s, the rest is white, 0.05 to 0.4
  of the total. The studies' worlds have 1.5 m over 60 to 600 s beside 0.4 to 0.7 m white (real-boats.md section 3,
  judge.md; honest-filter.md section 5 adds 20 s); receivers on two moored boats wander by 1.3 and 2.1 m at HDOP 1.1,
  0.98 and 0.99 correlated over 1 s (benchmarks/real_boats.py). Half of them have SBAS (quality 2). Receivers on one
  boat share part of what lasts (orbits, ionosphere), the rest is each one's own (multipath).
* HDOP wanders by 12 % over 2 minutes. HDOP x `UERE_M` and GST tell the total with an error of up to 30 % each, constant
  for a receiver (issue 14).
* Velocity: noise 0.02 to 0.06 m/s an axis, and as much again that lasts seconds; SOG and COG of RTK receivers agree
  with differentiated positions to 0.036 to 0.048 m/s (real-boats.md section 5.1). Half of the receivers smooth it over
  0.3 to 0.8 s (judge.md: 0.5 s). Half hold the course when slow, a quarter say 0 m/s when slow (static navigation; trap
  4 of honest-filter.md).
* An untold latency of up to 0.5 s in three receivers of ten, as of 0.5 s in the study's stress.
* Quality: losses come at random and last about as long as `Losses` says; real degradation of an RTK receiver is
  5, 0, 1, 2, 1, 0 ... 4 within 10 s (real-boats.md section 2). It takes seconds to grow worse and none to grow better.
* The antenna stands 0.3 to 1.0 m above the boat's point and swings with roll and pitch; its lever arm is the file's.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from common.boat_config import SensorTable
from common.geodesy import LocalPlane
from common.simulation.motion import Array, Truth, sample_times_s
from common.simulation.readings import FixReading, Timed
from common.simulation.recurrences import held, lagged, recur
from common.simulation.sensor_errors import drift_path, gauss_markov
from common.simulation.sensor_models import Draws, at_antenna

Quality = npt.NDArray[np.int64]
UERE_M: Final = {0: 4.0, 1: 2.0, 2: 1.4, 4: 0.012, 5: 0.3}
"""1-sigma of a position on each axis at HDOP 1 by quality as in GGA, m. RTK receivers state 1 cm and some dm.
Without a fix the error grows meanwhile, unseen."""
WORSE_LAG_S: Final = 3.0


@dataclass(frozen=True, slots=True)
class Loss:
    """The receiver falls to another quality at random."""

    quality: int
    every_s: float
    """Mean time between the ends and the beginnings, s."""
    lasts_s: float
    """Mean length of such a loss, s."""


@dataclass(frozen=True, slots=True)
class Reception:
    """What kind of receivers the boats of a scenario have, and how well they see the sky."""

    quality: tuple[int, ...]
    """Qualities on a good day, as in GGA; a receiver draws one of them."""
    losses: tuple[Loss, ...]
    """Later ones win over earlier ones."""
    hdop: tuple[float, float] = (0.7, 1.3)
    """Middle HDOP of a receiver is drawn in here."""


OPEN_SKY: Final = Reception((1, 2), (Loss(1, 600.0, 40.0), Loss(0, 2400.0, 6.0)))
BETWEEN_WALLS: Final = Reception((1, 2), (Loss(1, 150.0, 40.0), Loss(0, 300.0, 8.0)), hdop=(0.9, 2.2))
RTK: Final = Reception((4,), (Loss(5, 150.0, 25.0), Loss(1, 220.0, 20.0), Loss(0, 500.0, 6.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Receiver:
    """What is drawn once for a receiver."""

    quality: int
    lasts_s: float
    """Correlation time of the position error, s."""
    white_share: float
    """White part as a fraction of the total 1-sigma."""
    sky_share: float
    """Share of the lasting variance that all receivers of the boat see alike."""
    hdop: float
    truth_over_hdop: float
    """True 1-sigma over HDOP x UERE."""
    gst_over_truth: float
    """GST over the true 1-sigma."""
    sends_gst: bool
    velocity_m_s: float
    """1-sigma of the velocity's white part on each axis, m/s; the lasting part has the same."""
    velocity_lag_s: float
    course_held_m_s: float
    """Below this speed the course stays as it was, m/s; 0 = never."""
    still_m_s: float
    """Below this speed the receiver says 0, m/s."""
    late_s: float
    mast_m: float
    minute_decimals: int


def drawn_receiver(rng: np.random.Generator, reception: Reception) -> Receiver:
    """A receiver of the kind; each draw is made whatever the ones before say."""
    quality = int(rng.choice(reception.quality))
    rtk = quality == 4
    lag_s, held_m_s, still_m_s, late_s = rng.uniform((0.3, 0.15, 0.1, 0.05), (0.8, 0.5, 0.4, 0.5)).tolist()
    lags, holds, stands, delays, tells = (rng.uniform(size=5) < (0.5, 0.5, 0.25, 0.3, 0.4)).tolist()
    return Receiver(
        quality=quality,
        lasts_s=float(np.exp(rng.uniform(np.log(20.0), np.log(600.0)))),
        white_share=float(np.exp(rng.uniform(np.log(0.05), np.log(0.4)))),
        sky_share=rng.uniform(0.3, 0.7),
        hdop=rng.uniform(*reception.hdop),
        truth_over_hdop=float(np.exp(rng.uniform(np.log(0.77), np.log(1.3)))),
        gst_over_truth=float(np.exp(rng.uniform(np.log(0.77), np.log(1.3)))),
        sends_gst=tells or rtk,
        velocity_m_s=rng.uniform(0.02, 0.06) * (0.5 if rtk else 1.0),
        velocity_lag_s=lag_s if lags and not rtk else 0.0,
        course_held_m_s=held_m_s if holds and not rtk else 0.0,
        still_m_s=still_m_s if stands and not rtk else 0.0,
        late_s=late_s if delays else 0.0,
        mast_m=rng.uniform(0.3, 1.0),
        minute_decimals=7 if rtk else int(rng.choice((4, 5))),
    )


def fixes(truth: Truth, sensor: SensorTable, draws: Draws, reception: Reception, plane: LocalPlane) -> Iterator[Timed]:
    """Readings of one receiver over the whole truth; while there is no fix it says quality 0 and no velocity."""
    receiver = drawn_receiver(draws.of(f"{sensor.id} made")[0], reception)
    t_s = sample_times_s(truth, sensor)
    quality = qualities(draws.of(f"{sensor.id} quality")[0], t_s, receiver.quality, reception.losses)
    hdop = _hdop(draws, sensor.id, t_s, receiver)
    sigma_m = position_sigma_m(t_s, quality, hdop, receiver)
    antenna = at_masthead(truth, sensor, receiver.mast_m)
    seen = antenna.at(t_s - receiver.late_s)
    place = np.stack((seen.east_m, seen.north_m), axis=1) + position_error_m(draws, sensor.id, t_s, sigma_m, receiver)
    velocity = _velocity(draws, sensor.id, antenna, t_s, receiver)
    gst_m = receiver.gst_over_truth * sigma_m
    satellites = np.clip(np.round(9.5 - 4.0 * np.log(hdop)), 4, 14).astype(int)
    rows = zip(t_s, place, velocity, quality, satellites, hdop, gst_m, strict=True)
    for t, at, v, q, n, dop, gst in (tuple(part.tolist() for part in row) for row in rows):
        v_east, v_north = v if q else (None, None)
        told_m = gst if receiver.sends_gst and q else None
        yield Timed(
            t,
            sensor.id,
            FixReading(
                *plane.to_lat_lon_deg(*at),
                v_east,
                v_north,
                q,
                n,
                dop,
                told_m,
                told_m,
                receiver.late_s,
                receiver.minute_decimals,
            ),
        )


def qualities(rng: np.random.Generator, t_s: Array, usual: int, losses: tuple[Loss, ...]) -> Quality:
    """Quality as in GGA at each time; losses of each kind begin and end at random, whatever the sampling."""
    quality = np.full(len(t_s), usual)
    seeds = rng.integers(0, 2**63, len(losses)).tolist()
    for loss, own in zip(losses, map(np.random.default_rng, seeds), strict=True):
        at_s = own.exponential(loss.every_s)
        while at_s <= t_s[-1]:
            until_s = at_s + loss.lasts_s * own.uniform(0.3, 1.7)
            quality[(t_s >= at_s) & (t_s < until_s)] = loss.quality
            at_s = until_s + own.exponential(loss.every_s)
    return quality


def _hdop(draws: Draws, sensor: str, t_s: Array, receiver: Receiver) -> Array:
    normals = draws.normals(f"{sensor} hdop", len(t_s), 1)[0]
    return receiver.hdop * np.exp(drift_path(gauss_markov(0.12, 120.0), t_s, normals)[:, 0])


def position_sigma_m(t_s: Array, quality: Quality, hdop: Array, receiver: Receiver) -> Array:
    """True 1-sigma of the position on each axis, m: it follows a worse quality within seconds, a better one at once."""
    target = receiver.truth_over_hdop * np.array([UERE_M.get(q, 1.6) for q in range(6)])[quality] * hdop
    better = np.diff(target, prepend=target[0]) < 0.0
    keep = np.where(better, 0.0, np.exp(-np.diff(t_s, prepend=t_s[0]) / WORSE_LAG_S))
    driven = (1.0 - keep) * target
    driven[0] = target[0]
    return recur(keep[1:], driven)


def position_error_m(draws: Draws, sensor: str, t_s: Array, sigma_m: Array, receiver: Receiver) -> Array:
    """Error of the position, east and north (n, 2): the shared sky, what lasts at this antenna, white noise."""
    sky = draws.beginning("sky")
    every_s = np.arange(int(t_s[-1]) + 2, dtype=np.float64)
    sky_lasts_s = float(np.exp(sky.uniform(np.log(60.0), np.log(600.0))))
    path = drift_path(gauss_markov(1.0, sky_lasts_s), every_s, sky.standard_normal((len(every_s), 2)))
    shared = np.stack([np.interp(t_s, every_s, path[:, axis]) for axis in range(2)], axis=1)
    own = drift_path(gauss_markov(1.0, receiver.lasts_s), t_s, draws.normals(f"{sensor} drift", len(t_s), 2)[0])
    lasting = np.sqrt(receiver.sky_share) * shared + np.sqrt(1.0 - receiver.sky_share) * own
    white = draws.normals(sensor, len(t_s), 2)[0]
    unit: Array = np.sqrt(1.0 - receiver.white_share**2) * lasting + receiver.white_share * white
    error: Array = sigma_m[:, np.newaxis] * unit
    return error


def at_masthead(truth: Truth, sensor: SensorTable, mast_m: float) -> Truth:
    """The track of the antenna, velocity included: lever arm of the file, on a mast that swings with roll and pitch."""
    foot = at_antenna(truth, sensor)
    aft = 0.0 if truth.pitch_rad is None else mast_m * np.sin(truth.pitch_rad)
    stb = 0.0 if truth.roll_rad is None else mast_m * np.sin(truth.roll_rad)
    sin, cos = np.sin(truth.heading_rad), np.cos(truth.heading_rad)
    east, north = foot.east_m - sin * aft + cos * stb, foot.north_m - cos * aft - sin * stb
    arm = np.stack((east - truth.east_m, north - truth.north_m))
    swing = np.diff(arm, axis=1, prepend=arm[:, :1]) / np.diff(truth.t_s, prepend=truth.t_s[0] - 1.0)
    v_east, v_north = truth.v_east_m_s + swing[0], truth.v_north_m_s + swing[1]
    return replace(truth, east_m=east, north_m=north, v_east_m_s=v_east, v_north_m_s=v_north)


def _velocity(draws: Draws, sensor: str, antenna: Truth, t_s: Array, receiver: Receiver) -> Array:
    step_s = float(antenna.t_s[1] - antenna.t_s[0])
    true = np.stack((antenna.v_east_m_s, antenna.v_north_m_s), axis=1)
    smooth = lagged(true, step_s, receiver.velocity_lag_s)
    seen = np.stack([np.interp(t_s - receiver.late_s, antenna.t_s, smooth[:, axis]) for axis in range(2)], axis=1)
    normals = draws.normals(f"{sensor} velocity", len(t_s), 4)[0]
    lasting = drift_path(gauss_markov(receiver.velocity_m_s, 5.0), t_s, normals[:, 2:])
    return frozen(seen + receiver.velocity_m_s * normals[:, :2] + lasting, receiver)


def frozen(velocity_m_s: Array, receiver: Receiver) -> Array:
    """What a slow receiver says (n, 2): speed as measured along the last course, or nothing at all."""
    speed = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
    course = held(np.arctan2(velocity_m_s[:, 0], velocity_m_s[:, 1]), speed >= receiver.course_held_m_s)
    said = np.where(speed < receiver.still_m_s, 0.0, speed)
    shown: Array = said[:, np.newaxis] * np.stack((np.sin(course), np.cos(course)), axis=1)
    return shown
