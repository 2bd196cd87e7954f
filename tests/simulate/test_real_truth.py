"""Drawn tracks and hulls: physics, limits of the scenario, and a new boat from each seed."""

import numpy as np
import pytest

from common.simulation.drawn_tracks import programme
from common.simulation.motion import Truth
from common.simulation.scenarios_real import REAL_SCENARIOS, RealScenario
from common.simulation.waves import narrow_band

BY_NAME = {scenario.name: scenario for scenario in REAL_SCENARIOS}
LARGEST = {
    "lake": (2.0, 20.0),
    "coast": (3.0, 12.0),
    "harbour": (1.2, 25.0),
    "anchor": (0.0, 0.0),
    "6ms": (6.5, 8.0),
    "10ms": (11.0, 12.0),
    "rtk": (3.0, 15.0),
}
"""Way through the water (m/s) and turn (deg/s) that the scenarios ask for at most."""
COLUMNS = ("t_s", "east_m", "north_m", "v_east_m_s", "v_north_m_s", "heading_rad", "roll_rad", "pitch_rad")


def columns(truth: Truth) -> np.ndarray:
    return np.stack([getattr(truth, name) for name in COLUMNS], axis=1)


def along_and_athwart(truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    sin, cos = np.sin(truth.heading_rad), np.cos(truth.heading_rad)
    return sin * truth.v_east_m_s + cos * truth.v_north_m_s, cos * truth.v_east_m_s - sin * truth.v_north_m_s


@pytest.fixture(params=BY_NAME)
def scenario(request: pytest.FixtureRequest) -> RealScenario:
    return BY_NAME[request.param]


def test_the_names_are_those_of_the_issue() -> None:
    asked = "real-lake real-coast real-harbour real-anchor real-6ms real-10ms real-rtk"
    assert list(BY_NAME) == asked.split()
    assert {scenario.group for scenario in REAL_SCENARIOS} == {"real boats"}
    assert all(scenario.text and 600.0 <= scenario.seconds <= 900.0 for scenario in REAL_SCENARIOS)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_track_is_whole_smooth_and_within_what_its_scenario_says(scenario: RealScenario, seed: int) -> None:
    truth = scenario.truth(seed)
    table = columns(truth)
    assert np.isfinite(table).all()
    assert truth.t_s[-1] == scenario.seconds
    for place, velocity in ((truth.east_m, truth.v_east_m_s), (truth.north_m, truth.v_north_m_s)):
        np.testing.assert_allclose(np.diff(place), 0.025 * (velocity[1:] + velocity[:-1]), atol=1e-9)
    kind = scenario.name.removeprefix("real-")
    way, turn = LARGEST[kind]
    besides = 1.5 * scenario.weather.current_m_s + 0.3 + 5.0 * 1.5 * scenario.weather.sea.drift_m_s + 0.3 * way
    if kind == "anchor":
        besides = 2.0
    assert np.hypot(truth.v_east_m_s, truth.v_north_m_s).max() < way + besides
    turn_deg_s = np.abs(np.degrees(np.diff(truth.heading_rad))) / 0.05
    assert np.percentile(turn_deg_s, 99.0) < 1.2 * turn + 8.0
    assert np.degrees(np.abs(truth.roll_rad).max()) < 50.0  # type: ignore[arg-type]
    # No step is a jump: below 1.5 g, 60 deg/s.
    assert np.abs(np.diff(table[:, 3:5], axis=0)).max() / 0.05 < 15.0
    assert turn_deg_s.max() < 60.0


def test_a_seed_is_a_boat_and_a_longer_run_goes_on_from_a_shorter(scenario: RealScenario) -> None:
    first, longer = scenario.truth(5, 200.0), scenario.truth(5, 500.0)
    np.testing.assert_array_equal(columns(first), columns(longer)[: len(first.t_s)])
    np.testing.assert_array_equal(columns(scenario.truth(5, 200.0)), columns(first))
    other = scenario.truth(6, 200.0)
    assert np.hypot(other.east_m - first.east_m, other.north_m - first.north_m).max() > 3.0


@pytest.mark.parametrize("seconds", [0.0, 0.01])
def test_the_shortest_voyage_is_one_step(scenario: RealScenario, seconds: float) -> None:
    short = scenario.truth(5, seconds)
    np.testing.assert_array_equal(columns(short), columns(scenario.truth(5, 1.0))[:2])


def test_hulls_heel_and_slide_outward_in_turns_and_lift_their_bows() -> None:
    slopes = []
    for seed in range(1, 11):
        truth = BY_NAME["real-10ms"].truth(seed, 400.0)
        ahead, athwart = along_and_athwart(truth)
        turn = np.gradient(truth.heading_rad, 0.05)
        quick = np.abs(turn) > np.radians(5.0)
        assert truth.roll_rad is not None
        assert truth.pitch_rad is not None
        if quick.sum() > 400:
            slopes.append(
                [np.polyfit((ahead * turn)[quick], column[quick], 1)[0] for column in (truth.roll_rad, athwart)]
            )
        assert np.degrees(truth.pitch_rad.mean()) > 2.0
    heel, slide = np.median(slopes, axis=0)
    # Of 0 to 0.21 rad and 0 to 1.47 s, less what the lags take.
    assert -0.2 < heel < -0.03
    assert -1.4 < slide < -0.1


def test_boats_turn_to_both_sides_stop_and_go_astern() -> None:
    for seed in range(1, 4):
        truth = BY_NAME["real-harbour"].truth(seed, 900.0)
        turn = np.degrees(np.gradient(truth.heading_rad, 0.05))
        assert (turn > 3.0).sum() > 200
        assert (turn < -3.0).sum() > 200
    ahead = np.concatenate([along_and_athwart(BY_NAME["real-harbour"].truth(seed))[0] for seed in range(1, 6)])
    assert (np.abs(ahead) < 0.15).mean() > 0.05
    habits = BY_NAME["real-harbour"].habits
    assert habits is not None
    asked = np.concatenate([programme(np.random.default_rng(seed), habits, 18_000).way_m_s for seed in range(5)])
    assert 0.02 < (asked < -0.25).mean() < 0.3
    assert asked.min() >= -0.8
    assert (asked == 0.0).mean() > 0.05


def test_an_anchored_boat_stays_on_its_rode_and_looks_to_its_anchor() -> None:
    for seed in range(1, 6):
        truth = BY_NAME["real-anchor"].truth(seed)
        assert np.hypot(np.ptp(truth.east_m), np.ptp(truth.north_m)) < 2.9 * 45.0
        assert np.hypot(truth.v_east_m_s, truth.v_north_m_s).mean() < 0.8
        assert np.degrees(truth.heading_rad.std()) > 4.0  # it yaws


def test_waves_have_the_size_and_band_that_was_asked_for() -> None:
    t_s = np.arange(20_000.0) * 0.05
    spread = [narrow_band(np.random.default_rng(seed), t_s, 2.0, 0.3).std() for seed in range(20)]
    assert abs(float(np.mean(spread)) / 2.0 - 1.0) < 0.05
    power = np.abs(np.fft.rfft(narrow_band(np.random.default_rng(1), t_s, 2.0, 0.3))) ** 2
    hz = np.fft.rfftfreq(len(t_s), 0.05)
    assert power[(hz > 0.15) & (hz < 0.45)].sum() > 0.98 * power[1:].sum()
