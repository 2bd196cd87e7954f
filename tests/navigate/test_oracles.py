"""Oracles for the filters: exact moments, the augmented unscented form, and each other.

None of them shares code with what it judges, but for the motion itself.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from common.simulation.monte_carlo_runs import Runs, draw_runs
from common.simulation.motion import Mission
from common.simulation.scenario import with_noise
from common.simulation.scenarios import find_scenario
from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import Filter
from shore.navigation.kalman import Predicted
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, Input, ProcessNoise, move
from shore.navigation.noise.noise_rule import Channel, FixedNoise
from shore.navigation.numbers import Array, wrapped
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import FIVE, Gaussian

Predict = Callable[[Gaussian, float, Input | None, ProcessNoise], Predicted]


def predict_exactly(before: Gaussian, dt_s: float, imu: Input | None, noise: ProcessNoise) -> Predicted:
    """The moments of the motion of a Gaussian in closed form; no sigma points, no derivatives, one boat.

    The heading m in the middle of the step is Gaussian (mu, s^2), so E sin m = e sin mu and E cos m = e cos mu with
    e = exp(-s^2/2), and likewise of 2 m with e^4; and cov(y, g(m)) = cov(y, m) E g'(m) for what is jointly Gaussian
    (Stein). Of the acceleration a = (sin m f + cos m r, cos m f - sin m r), with a' = (a_north, -a_east):
    cov(y, a) = cov(y, m) E a'; second moments from sin^2 = (1 - cos 2m) / 2 and sin cos = sin 2m / 2.
    """
    assert imu is not None
    _, x, P = before
    f, r, w = (float(value or 0.0) for value in imu)
    mu, s2 = float(x[4]) + 0.5 * w * dt_s, float(P[4, 4])
    once, twice = math.exp(-0.5 * s2), math.exp(-2.0 * s2)
    sin, cos = once * math.sin(mu), once * math.cos(mu)
    sin_sin, cos_cos = 0.5 * (1.0 - twice * math.cos(2.0 * mu)), 0.5 * (1.0 + twice * math.cos(2.0 * mu))
    sin_cos = 0.5 * twice * math.sin(2.0 * mu)
    a = np.array([sin * f + cos * r, cos * f - sin * r])
    across = (f * f - r * r) * sin_cos + f * r * (cos_cos - sin_sin)
    second = np.array(
        [
            [f * f * sin_sin + r * r * cos_cos + 2.0 * f * r * sin_cos, across],
            [across, f * f * cos_cos + r * r * sin_sin - 2.0 * f * r * sin_cos],
        ]
    )
    F, B = np.eye(5), np.zeros((5, 2))
    F[0, 2] = F[1, 3] = dt_s
    B[0, 0] = B[1, 1] = 0.5 * dt_s * dt_s
    B[2, 0] = B[3, 1] = dt_s
    mean = F @ x + B @ a
    mean[4] += w * dt_s
    with_a = np.outer(F @ P[:, 4], np.array([a[1], -a[0]]))
    spread = F @ P @ F.T + with_a @ B.T + B @ with_a.T + B @ (second - np.outer(a, a)) @ B.T
    q = noise.accel_fwd**2 / dt_s  # both axes alike: no direction
    spread += q * B @ B.T
    spread[4, 4] += float(noise.yaw_rate) ** 2 * dt_s
    mean[4] = wrapped(float(mean[4]))
    return Predicted(mean, 0.5 * (spread + spread.T), lambda: np.zeros((5, 5)))


def augmented(*, through_motion: bool) -> Predict:
    """Thesis Eqs 4.45-4.53 with the noise as part of the state, n = 8, alpha 1, kappa 0, beta 2; for one boat.

    The noise either disturbs the input of the motion, or is added behind it as Eq. 4.29 has it (turned by the heading
    in the middle of the step).
    """

    def moved(x: Array, offset: Array, dt_s: float, imu: ImuInput) -> Array:
        if through_motion:
            return move(FIVE, x + offset[:5], dt_s, ImuInput(*(np.array(imu) + offset[5:])))
        fwd, stb, turn = offset[5:]
        middle = x[4] + 0.5 * imu.yaw_rate_rad_s * dt_s
        sin, cos = math.sin(middle), math.cos(middle)
        a = np.array([sin * fwd + cos * stb, cos * fwd - sin * stb])
        added = np.array([*(0.5 * dt_s**2 * a), *(dt_s * a), dt_s * turn])
        result: Array = move(FIVE, x + offset[:5], dt_s, imu) + added
        return result

    def predict(before: Gaussian, dt_s: float, imu: Input | None, noise: ProcessNoise) -> Predicted:
        assert isinstance(imu, ImuInput)
        _, x, P = before
        n = 8
        L = np.zeros((n, n))
        L[:5, :5] = np.linalg.cholesky(P)
        L[5:, 5:] = np.diag([float(density) / math.sqrt(dt_s) for density in noise[:3]])
        offsets = np.concatenate([np.zeros((1, n)), math.sqrt(n) * L.T, -math.sqrt(n) * L.T])
        points = np.stack([moved(x, offset, dt_s, imu) for offset in offsets])
        each = 0.5 / n
        mean = np.array([0.0] + [each] * 2 * n) @ points
        apart = points - mean
        spread = apart.T @ (np.array([2.0] + [each] * 2 * n)[:, np.newaxis] * apart)
        mean[4] = wrapped(float(mean[4]))
        return Predicted(mean, 0.5 * (spread + spread.T), lambda: np.zeros((5, 5)))

    return predict


def facts_of(runs: Runs) -> FilterFacts:
    """The true noise of a run's first phase."""
    channels = {
        "gps1.east": Channel(float(runs.gps_m[1, 0]) ** 2),
        "gps1.north": Channel(float(runs.gps_m[1, 1]) ** 2),
        "compass1.heading": Channel(float(runs.compass_sigma_rad[1]) ** 2),
    }
    accel, gyro = float(runs.accel_std[1, 0]), float(runs.gyro_std_rad[1])
    return FilterFacts(channels, imu_noise=ProcessNoise(accel, accel, gyro))


def most_apart(one: Filter, other: Filter, runs: Runs, sigmas: Array, every: int = 1) -> tuple[float, float]:
    """Largest difference over run 0: of x in sigmas, of P in correlation; measured every so many steps."""
    for each in (one, other):
        each.start(runs.truth[0].copy(), np.diag(sigmas**2))
    worst_x = worst_P = 0.0
    for step in range(1, len(runs.truth)):
        for each in (one, other):
            each.predict(1.0, ImuInput(*runs.imu[0, step].tolist()))
            if step % every == 0:
                each.update(Position(0, "gps1", *runs.gps[0, step].tolist()))
                each.update(TrueHeading(0, "compass1", float(runs.compass_rad[0, step])))
        a, b = one.estimate, other.estimate
        sigma = np.sqrt(b.P.diagonal())
        apart = a.x - b.x
        apart[4] = wrapped(float(apart[4]))
        worst_x = max(worst_x, float(np.abs(apart / sigma).max()))
        worst_P = max(worst_P, float(np.abs((a.P - b.P) / np.outer(sigma, sigma)).max()))
    return worst_x, worst_P


def plain(predict: Predict, facts: FilterFacts) -> Filter:
    return Filter("oracle", predict, FixedNoise(), facts)


START = np.array([1.0, 1.0, 0.1, 0.1, math.radians(0.5)])


def long_mission() -> Runs:
    """Track T1 of the thesis and back, again and again: 10,000 steps, one run."""
    scenario = find_scenario("4.4-T1")
    assert isinstance(scenario.mission, Mission)
    back = ((650.0, 385.0), (765.0, 728.0))
    waypoints = (*scenario.mission.waypoints, *back) * 20
    return draw_runs(
        replace(scenario, mission=replace(scenario.mission, waypoints=waypoints, longest_s=10_000.0)), 1, 1
    )


@pytest.mark.slow
def test_ukf_has_the_exact_moments_over_10_000_steps() -> None:
    runs = long_mission()
    facts = facts_of(runs)
    assert len(runs.truth) == 10_001
    x, P = most_apart(build_filter("ukf", facts), plain(predict_exactly, facts), runs, START)
    print(f"UKF and exact moments: {x:.1e} sigma, {P:.1e}")
    assert max(x, P) < 1e-5  # asked: 1e-3


@pytest.mark.parametrize(("heading_deg", "most"), [(0.5, 1e-5), (5.0, 1e-3)])
def test_ukf_has_the_exact_moments_while_fixes_are_rare(heading_deg: float, most: float) -> None:
    """Measured every 10 s only; a wider heading shows the fourth moments, which three points cannot have."""
    runs = first_steps("4.4-T1", 300)
    facts, sigmas = facts_of(runs), START.copy()
    sigmas[4] = math.radians(heading_deg)
    assert max(most_apart(build_filter("ukf", facts), plain(predict_exactly, facts), runs, sigmas, 10)) < most


def first_steps(name: str, steps: int) -> Runs:
    scenario = find_scenario(name)
    runs = draw_runs(scenario, 1, 1)
    return replace(runs, truth=runs.truth[: steps + 1])


def test_noise_in_the_state_gives_the_same() -> None:
    """Added behind the motion: alike but for the spread of the points, sqrt(8) sigma and sqrt(5) sigma.

    Disturbing the input: gyro noise turns the acceleration of its own step, a / 2 times 0.033 deg against the
    accelerometer's 0.004 m/s^2: 0.4 % at the turns' 0.056 m/s^2. That is what the additive Q leaves out.
    """
    runs = first_steps("4.4-T1", 400)
    facts = facts_of(runs)
    added, through = (
        max(most_apart(build_filter("ukf", facts), plain(augmented(through_motion=way), facts), runs, START))
        for way in (False, True)
    )
    assert added < 1e-5
    assert 1e-4 < through < 5e-3


def errors(name: str, runs: Runs, sigmas: Array) -> Array:
    """Mean squared error of each run, (runs, 3): east, north in m^2, heading in deg^2."""
    each = build_filter(name, facts_of(runs))
    x = runs.truth[0] + sigmas * runs.start_noise[:, :5]
    each.start(x, np.tile(np.diag(sigmas**2), (len(x), 1, 1)))
    squares = np.zeros((len(x), 3))
    for step in range(1, len(runs.truth)):
        each.predict(1.0, ImuInput(*np.ascontiguousarray(runs.imu[:, step].T)))
        each.update(Position(0, "gps1", *np.ascontiguousarray(runs.gps[:, step].T)))
        each.update(TrueHeading(0, "compass1", runs.compass_rad[:, step]))
        apart = each.estimate.x[:, [0, 1, 4]] - runs.truth[step, [0, 1, 4]]
        apart[:, 2] = np.degrees(wrapped(apart[:, 2]))
        squares += np.square(apart)
    return squares / (len(runs.truth) - 1)


@pytest.mark.parametrize(
    "name", ["4.2", *(pytest.param(name, marks=pytest.mark.slow) for name in ("4.3-0.5", "4.4-T1", "5.1", "5.2"))]
)
def test_on_the_thesis_scenarios_all_three_are_one_filter(name: str) -> None:
    """300 runs, R right: MSEs equal to 0.1 % (KF) and to 0.01 % (EKF)."""
    scenario = find_scenario(name)
    runs = draw_runs(scenario, 300, 2)
    sigmas = np.array(scenario.assumed.start_sigmas)
    kf, ekf, ukf = (errors(each, runs, sigmas).mean(axis=0) for each in ("kf", "ekf", "ukf"))
    print(name, "KF / UKF - 1:", kf / ukf - 1.0, "EKF / UKF - 1:", ekf / ukf - 1.0)
    assert np.abs(kf / ukf - 1.0).max() < 1e-3
    assert np.abs(ekf / ukf - 1.0).max() < 1e-4


def paired(one: Array, other: Array) -> float:
    """Mean of the paired differences one - other in its own standard errors."""
    apart = one - other
    return float(apart.mean() / apart.std(ddof=1) * math.sqrt(len(apart)))


def test_an_agile_boat_on_a_poorly_known_heading_needs_the_better_filter() -> None:
    """4 m/s, 15 deg/s, compass noise and first heading 60 deg: position KF > EKF > UKF, 200 paired runs."""
    runs = draw_runs(with_noise(find_scenario("agile"), compass_deg=60.0), 200, 1)
    sigmas = np.array([*find_scenario("agile").assumed.start_sigmas[:4], math.radians(60.0)])
    kf, ekf, ukf = (errors(each, runs, sigmas) for each in ("kf", "ekf", "ukf"))
    print("agile, 60 deg: KF, EKF, UKF", *(each.mean(axis=0).round(2) for each in (kf, ekf, ukf)))
    places = [each[:, :2].sum(axis=1) for each in (kf, ekf, ukf)]
    assert places[0].mean() > 3.0 * places[1].mean()
    assert places[1].mean() > 1.2 * places[2].mean()
    assert paired(places[0], places[1]) > 5.0
    assert paired(places[1], places[2]) > 3.0


def test_in_the_scenario_agile_only_the_kf_falls_behind() -> None:
    """Compass noise 20 deg: EKF and UKF are still one filter."""
    scenario = find_scenario("agile")
    runs = draw_runs(scenario, 200, 1)
    sigmas = np.array(scenario.assumed.start_sigmas)
    kf, ekf, ukf = (errors(each, runs, sigmas) for each in ("kf", "ekf", "ukf"))
    print("agile: KF, EKF, UKF", *(each.mean(axis=0).round(2) for each in (kf, ekf, ukf)))
    assert kf[:, 1].mean() > 1.7 * ukf[:, 1].mean()
    assert paired(kf[:, 1], ukf[:, 1]) > 5.0
    assert ekf.mean(axis=0) == pytest.approx(ukf.mean(axis=0), rel=0.01)
