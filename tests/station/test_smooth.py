"""A log's smoothed track: as many estimates as frames, from the same states as live, nearer to the truth."""

import csv
import json
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from common.boat_config import BoatConfig
from common.codec import decode_frame, encode_frame
from common.errors import WayfixError
from common.messages import Fix, Frame
from common.simulation.scenarios import scenario_voyage
from shore.main import main
from shore.navigation.kalman import Predicted
from shore.navigation.motion_model import ImuInput, ProcessNoise
from shore.navigation.state_space import Gaussian
from shore.navigation.ukf import predict_unscented
from shore.pipeline import Pipeline
from shore.replay.smooth import COLUMNS, smooth_log, write_track
from shore.report.reference import read_reference
from tests import offline
from tests.navigate import voyages
from tests.offline import compensated, errors_of, frames_of
from tests.station.logs import log_of


@pytest.fixture(scope="module")
def minute() -> tuple[BoatConfig, list[Frame]]:
    voyage = scenario_voyage("5.1", seed=3, seconds=60.0)
    return voyage.config, frames_of(voyage)


def test_it_ends_where_the_live_filter_ends(minute: tuple[BoatConfig, list[Frame]]) -> None:
    config, frames = minute
    pipeline = Pipeline(config, ["fuzzy"])
    live = [estimate for frame in frames for estimate in pipeline.push(frame).estimates]
    smooth = smooth_log(config, frames, "fuzzy")
    assert [each.t_ns for each in smooth] == [frame.t1_ns for frame in frames][-len(smooth) :]
    assert [(each.boot_id, each.seq) for each in smooth[-5:]] == [(frame.boot_id, frame.seq) for frame in frames[-5:]]
    assert len(smooth) >= len(live)
    assert smooth[-1].filter == "fuzzy-smoothed"
    apart = np.array(smooth[-1].state) - np.array(live[-1].state)
    # a step of the IMU is cut at each frame's end, so the sums are rounded elsewhere
    assert np.abs(apart[:2]).max() < 0.01 * live[-1].sigma_east_m
    assert smooth[300].sigma_east_m < live[300].sigma_east_m


def test_another_clock_begins_anew(minute: tuple[BoatConfig, list[Frame]]) -> None:
    config, frames = minute
    rebooted = [replace(frame, clock_id="other", boot_id="other", start_no=2) for frame in frames]
    once, twice = smooth_log(config, frames, "ukf"), smooth_log(config, [*frames, *rebooted], "ukf")
    assert [each.state for each in twice] == [each.state for each in (*once, *once)]


def test_a_wrong_origin_is_left_behind(minute: tuple[BoatConfig, list[Frame]]) -> None:
    """The first fix was 5 deg off: the rest is smoothed about an origin of its own."""
    config, frames = minute
    first = next(index for index, frame in enumerate(frames) if frame.fixes)
    (fix,) = frames[first].fixes
    wrong = replace(frames[first], fixes=(replace(fix, lat_deg=far(fix)),))
    smooth = smooth_log(config, [*frames[:first], wrong, *frames[first + 1 :]], "ukf")
    assert smooth[-1].origin_lat_deg != far(fix)
    assert abs(smooth[-1].lat_deg - 50.76) < 0.1


def far(fix: Fix) -> float:
    assert fix.lat_deg is not None
    return fix.lat_deg + 5.0


def test_a_state_that_is_not_finite_costs_nothing_of_what_came_before(
    minute: tuple[BoatConfig, list[Frame]], monkeypatch: pytest.MonkeyPatch
) -> None:
    config, frames = minute
    passes = count()

    def fail_once(before: Gaussian, dt_s: float, imu: ImuInput | None, noise: ProcessNoise) -> Predicted:
        predicted = predict_unscented(before, dt_s, imu, noise)
        return predicted._replace(x=np.full_like(predicted.x, np.nan)) if next(passes) == 800 else predicted

    monkeypatch.setattr("shore.navigation.filter_registry.REGISTRY", {"ukf": (fail_once, "fixed")})
    smooth = smooth_log(config, frames, "ukf")
    times = [each.t_ns for each in smooth]
    assert next(passes) > 1000
    assert set(times) >= {frame.t1_ns for frame in (*frames[20:300], *frames[-100:])}
    assert np.isfinite([each.state for each in smooth]).all()


def test_the_file_is_a_reference(minute: tuple[BoatConfig, list[Frame]], tmp_path: Path) -> None:
    config, frames = minute
    smooth = smooth_log(config, frames, "ukf")
    path = tmp_path / "track.csv"
    write_track(path, smooth)
    with path.open(newline="") as file:
        assert tuple(next(csv.reader(file))) == COLUMNS
    reference = read_reference(path, 0)
    place = reference.at(smooth[100].t_ns)
    assert place is not None
    lat_deg, lon_deg = reference.plane.to_lat_lon_deg(*place[:2])
    assert (lat_deg, lon_deg) == pytest.approx((smooth[100].lat_deg, smooth[100].lon_deg), abs=1e-7)
    with pytest.raises(WayfixError, match="cannot be written"):
        write_track(tmp_path / "no" / "track.csv", smooth)


def test_replay_writes_and_scores_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two configurations in one log, as after a restart of the board with another file; scored against the truth."""
    truth = voyages.sail(62, 0.05)
    frames = [decode_frame(encode_frame(frame)) for frame in voyages.frames_of(truth, 2)]
    gps, *others = voyages.BOAT.sensor
    changed = replace(voyages.BOAT, sensor=(replace(gps, sigma_m=7.0), *others))
    frames[300:] = [replace(frame, boot_id="b2", start_no=2) for frame in frames[300:]]
    log = log_of(tmp_path, frames, {300: changed})
    track, reference = tmp_path / "track.csv", tmp_path / "truth.csv"
    write_truth(reference, truth)
    assert main(["replay", str(log), "--smooth", str(track), "--reference", str(reference), "--json"]) == 0
    output = capsys.readouterr().out
    summary = json.loads(output.splitlines()[-1])
    assert f"smoothed estimates of ukf in {track}" in output
    assert len(track.read_text().splitlines()) == summary["smoothed"]["estimates"] + 1
    assert summary["smoothed"]["estimates"] > 580
    assert summary["position_rms_m"]["ukf-smoothed"] < summary["position_rms_m"]["ukf"]


@pytest.mark.parametrize(
    ("target", "what"),
    [
        ("wayfix.mcap", "is what is read, it would be lost"),
        ("truth.csv", "is what is read, it would be lost"),
        ("no/track.csv", "cannot be written"),
        (".", "cannot be written"),
    ],
)
def test_a_track_never_takes_the_place_of_what_is_read(
    target: str, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = log_of(tmp_path, voyages.frames_of(voyages.sail(2, 0.05), 2), {})
    log = log.rename(tmp_path / "wayfix.mcap")
    reference = tmp_path / "truth.csv"
    reference.write_text("t_s\n")
    before = log.read_bytes(), reference.read_text()
    asked = ["replay", str(log), "--smooth", str(tmp_path / target), "--reference", str(reference)]
    assert main(asked) == 2
    assert what in capsys.readouterr().err
    assert before == (log.read_bytes(), reference.read_text())


def write_truth(path: Path, truth: voyages.Truth) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("t_s", "lat_deg", "lon_deg", "heading_true_deg", "t_ns"))
        for k, state in enumerate(truth.states[::4]):
            t_s = 4 * k * truth.dt_s
            lat, lon = voyages.HOME.to_lat_lon_deg(*state[:2])
            writer.writerow((t_s, lat, lon, np.degrees(state[4]), 10**9 + round(t_s * 1e9)))


@pytest.mark.slow
def test_it_is_nearer_to_the_truth_than_the_filter_was() -> None:
    """Paired: every one of 4 voyages of scenario 5.2, whose noise the filter must learn."""
    ratios = []
    for seed in range(4):
        voyage = compensated(scenario_voyage("5.2", seed=seed, seconds=200.0))
        live = errors_of(voyage, ["fuzzy"])["fuzzy"]
        smooth = offline._errors(voyage, smooth_log(voyage.config, frames_of(voyage), "fuzzy"))
        # what was before the filter began for good is not smoothed
        ratios.append((smooth.rms_m(0.1) / live.rms_m(0.1), smooth.rms_deg(0.1) / live.rms_deg(0.1)))
    print("smoothed / live RMS, position and heading:", np.round(ratios, 2).tolist())
    # A heading that the filter has set back after a start is no longer linked with what was before.
    assert np.max(ratios, axis=0)[0] < 1.0
    assert np.median(ratios, axis=0)[1] < 1.0
    assert np.median(ratios, axis=0)[0] < 0.8
