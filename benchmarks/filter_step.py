"""Time of one filter step: one boat with and without adaptation, filterpy's UKF beside it, and a thousand runs at once.

    python -m benchmarks.filter_step            # some 20 s
    python -m benchmarks.filter_step --json

A step is a prediction with an IMU sample, a position and a heading. All jobs are run in turn, `--repeats` times, so
that a slow moment of the machine meets them all; the figures are medians of processor time.
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from common.angles import wrap_rad
from common.units import NS_PER_S
from shore.navigation.filter_registry import build_filter
from shore.navigation.initial_state import first_of
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise, process_noise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import FIVE, Extra, StateSpace
from tests.navigate.filterpys import filterpy_ukf

NINE: Final = StateSpace(
    (
        Extra("gyro_bias_rad_s", math.radians(0.3), 1e-6),
        Extra("accel_bias_fwd_m_s2", 0.04, 1e-5),
        Extra("accel_bias_stb_m_s2", 0.04, 1e-5),
        Extra("tilt_leak_per_m", 0.2, limit=0.4),
    )
)
NOISE: Final = ProcessNoise(0.004, 0.004, math.radians(0.036))
CHANNELS: Final = {"g.east": Channel(64.0), "g.north": Channel(49.0), "c.heading": Channel(math.radians(0.8) ** 2)}
OPENING: Final = 70
"""Steps before the clock runs: `fuzzy` filters its opening again and again in them."""
ONE, MANY = 200, 20
"""Steps that are timed, of one boat and of a batch."""
RUNS: Final = 1000
START: Final = (0.0, 0.0, 0.7, 0.7, 0.8)
VARIANCES: Final = (64.0, 49.0, 0.25, 0.25, 1e-3)


class Data:
    """Readings of a boat that swings about its course; (steps, ...) or (steps, ..., runs)."""

    def __init__(self, steps: int, runs: int | None = None) -> None:
        rng, tail = np.random.default_rng(1), () if runs is None else (runs,)
        swing = np.radians(3.0) * np.sin(0.1 * np.arange(steps))
        shape = (steps, 3, *tail)
        sigma = np.array(NOISE).reshape(1, 3, *(1 for _ in tail))
        self.imu: Any = rng.normal(size=shape) * sigma
        self.imu[:, 2] += swing.reshape(-1, *(1 for _ in tail))
        track = 0.7 * np.arange(steps).reshape(-1, 1, *(1 for _ in tail))
        self.fixes: Any = track + rng.normal(size=(steps, 2, *tail)) * 7.5
        heading = 0.8 + np.cumsum(swing)
        self.headings: Any = heading.reshape(-1, *(1 for _ in tail)) + rng.normal(size=(steps, *tail)) * 0.014
        if runs is None:
            self.imu, self.fixes, self.headings = (each.tolist() for each in (self.imu, self.fixes, self.headings))


def ours(name: str, space: StateSpace, data: Data, steps: int, runs: int | None = None) -> float:
    """Processor time of a step, us; of a batch for each run."""
    facts = FilterFacts(CHANNELS, space, NOISE)
    each = build_filter(name, facts)
    x, P = first_of(facts, START, VARIANCES)
    each.start(*((x, P) if runs is None else (np.tile(x, (runs, 1)), np.tile(P, (runs, 1, 1)))))
    start_s = 0.0
    for step in range(OPENING + steps):
        if step == OPENING:
            start_s = time.process_time()
        each.predict(1.0, ImuInput(*data.imu[step]))
        each.update(Position(step * NS_PER_S, "g", *data.fixes[step]))
        each.update(TrueHeading(step * NS_PER_S, "c", data.headings[step]))
    seconds = time.process_time() - start_s
    assert each.estimate.healthy
    return seconds / steps / (runs or 1) * 1e6


def filterpys(data: Data, steps: int) -> float:
    """The same job for filterpy's UKF, which takes the three numbers at once."""
    R = np.diag([channel.initial_variance for channel in CHANNELS.values()])
    theirs = filterpy_ukf(np.array(START), np.diag(VARIANCES), R)
    start_s = 0.0
    for step in range(OPENING + steps):
        if step == OPENING:
            start_s = time.process_time()
        imu = ImuInput(*data.imu[step])
        theirs.Q = process_noise(FIVE, float(theirs.x[4]) + 0.5 * imu.yaw_rate_rad_s, 1.0, NOISE)
        theirs.predict(imu=imu)
        theirs.update(np.array([*data.fixes[step], wrap_rad(data.headings[step])]))
    return (time.process_time() - start_s) / steps * 1e6


def jobs() -> dict[str, Callable[[], float]]:
    one, many = Data(OPENING + ONE), Data(OPENING + MANY, RUNS)
    return {
        "ukf, n = 5": partial(ours, "ukf", FIVE, one, ONE),
        "filterpy's UKF, n = 5": partial(filterpys, one, ONE),
        "fuzzy, n = 5": partial(ours, "fuzzy", FIVE, one, ONE),
        "fuzzy, n = 9": partial(ours, "fuzzy", NINE, one, ONE),
        "ekf, n = 5": partial(ours, "ekf", FIVE, one, ONE),
        "ukf, n = 5, batch": partial(ours, "ukf", FIVE, many, MANY, RUNS),
        "fuzzy, n = 5, batch": partial(ours, "fuzzy", FIVE, many, MANY, RUNS),
        "ukf, n = 9, batch": partial(ours, "ukf", NINE, many, MANY, RUNS),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    work = jobs()
    times = {name: np.empty(arguments.repeats) for name in work}
    for repeat in range(arguments.repeats):
        for name, job in work.items():
            times[name][repeat] = job()
    ratio = times["filterpy's UKF, n = 5"] / times["ukf, n = 5"]
    if arguments.json:
        figures = {name: round(float(np.median(each)), 2) for name, each in times.items()}
        print(json.dumps({"us_per_step": figures, "filterpy_ratio": round(float(np.median(ratio)), 2)}))
        return
    for name, each in times.items():
        print(f"{name:24}{np.median(each):8.1f} us  [{each.min():.1f}-{each.max():.1f}]")
    print(f"{'filterpy / ours':24}{np.median(ratio):8.1f}     [{ratio.min():.1f}-{ratio.max():.1f}]")


if __name__ == "__main__":
    main()
