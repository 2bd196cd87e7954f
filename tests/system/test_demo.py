"""What the demo must show: scenario 5.3 on three fixed seeds, the same at any speed, and a real recording."""

import csv
import json
import math
import statistics
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from common.codec import decode_frame
from shore.logbook.log_reader import read_log
from tests.recordings import BLUEBOAT_235 as BLUEBOAT
from tests.recordings import BLUEBOAT_MAP
from tests.system.harness import command

SEEDS = (1, 2, 3)

pytestmark = [pytest.mark.slow, pytest.mark.alone]

Run = dict[str, Any]


def demo(directory: Path, *arguments: str | Path, seconds: float = 300.0) -> Run:
    done = command("wayfix", "demo", "--log", directory, "--headless", "--json", *arguments, seconds=seconds)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    """One run for each seed, one after the other: at eight times the speed each takes a core of a slow machine."""
    directory = tmp_path_factory.mktemp("demo")
    return [demo(directory / f"{n}", "--seed", f"{n}", "--speed", "8") for n in SEEDS]


class Short(NamedTuple):
    """Runs that sail beside each other after those."""

    slow: list[Run]
    """The first 90 s of the mission at speed 1."""
    fast: list[Run]
    """The same at eight times the speed."""
    recorded: Run | None
    """A real recording at eight times the speed; `None` = it is not here."""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Short:
    """Those of speed 1 hardly use the machine, so the others sail beside them, two at a time: late stamps tell."""
    directory = tmp_path_factory.mktemp("short")
    length = ("--seconds", "90", "--speed")
    recording = ("--recording", BLUEBOAT, "--map", BLUEBOAT_MAP, "--speed", "8")
    with ThreadPoolExecutor(3) as at_one, ThreadPoolExecutor(2) as at_eight:
        slow = at_one.map(lambda n: demo(directory / f"1-{n}", *length, "1"), range(3))
        recorded = at_eight.submit(demo, directory / "recorded", *recording) if BLUEBOAT.exists() else None
        fast = at_eight.map(lambda n: demo(directory / f"8-{n}", *length, "8"), range(5))
        return Short(list(slow), list(fast), recorded.result() if recorded is not None else None)


def test_no_frame_is_lost_on_any_seed(runs: list[Run]) -> None:
    for run in runs:
        assert run["frames"]["lost"] == 0
        assert run["frames"]["sent"] == run["frames"]["received"] > 7000


def test_fuzzy_position_is_at_most_035_of_raw_gps_on_each_seed(runs: list[Run]) -> None:
    ratios = [run["position_rms_m"]["fuzzy"] / run["position_rms_m"]["gps"] for run in runs]
    assert max(ratios) <= 0.35, ratios


def test_fuzzy_heading_is_at_most_half_of_the_compass_in_the_last_quarter(runs: list[Run]) -> None:
    # Pooled: one seed's last quarter holds only a few independent heading errors (docs/decisions.md).
    def pooled(name: str) -> float:
        return math.sqrt(sum(run["heading_rms_deg_last_quarter"][name] ** 2 for run in runs) / len(runs))

    assert pooled("fuzzy") <= 0.5 * pooled("compass"), (pooled("fuzzy"), pooled("compass"))
    # On a boat R of `ukf` begins at the scatter of the sensor too (docs/decisions.md, 82). Over 30 seeds without ports
    # the ratio is 1.006 in the mean and scatters by 0.05 from seed to seed: what three of them say has that interval.
    ratios = [run["heading_rms_deg_last_quarter"]["fuzzy"] / run["heading_rms_deg_last_quarter"]["ukf"] for run in runs]
    assert statistics.mean(ratios) - 1.645 * 0.05 / math.sqrt(len(ratios)) <= 1.05, ratios


def counts(run: Run) -> tuple[int, int, int]:
    """Fixes, headings and IMU samples in the log of a run."""
    frames = [decode_frame(data) for data in read_log(run["log"]).frames()]
    samples = sum(len(block.offset_us) for frame in frames for block in frame.imu)
    return sum(len(frame.fixes) for frame in frames), sum(len(frame.headings) for frame in frames), samples


def test_speed_one_and_eight_give_the_same_measurements_and_figures(short: Short) -> None:
    # Runs of one speed differ by how late the machine lets a stamp be, at eight times the speed eight times as much
    # (docs/decisions.md): the means must agree within 5 %, as far as the scatter of these runs can tell.
    slow, fast = short.slow, short.fast
    assert {counts(run) for run in fast} == {counts(run) for run in slow}
    assert len({counts(run) for run in fast}) == 1
    for key in ("position_rms_m", "heading_rms_deg"):
        for name in slow[0][key]:
            ones, eights = ([run[key][name] for run in runs] for runs in (slow, fast))
            ratio = statistics.mean(eights) / statistics.mean(ones)
            error = math.hypot(*(statistics.stdev(values) / math.sqrt(len(values)) for values in (ones, eights)))
            print(f"{key} {name}: speed 1 {ones}, speed 8 {eights}, ratio {ratio:.4f}")
            assert abs(ratio - 1.0) <= 0.05 + 2.0 * error / statistics.mean(ones), (key, name)


def test_a_real_recording_through_the_whole_path(short: Short) -> None:
    if short.recorded is None:
        pytest.skip("the recordings of ../shared/data are not here")
    run = short.recorded
    assert run["frames"]["lost"] == 0
    frames = [decode_frame(data) for data in read_log(run["log"]).frames()]
    boat = Path(run["log"]).parent / "boat"
    sent = [json.loads(line) for line in (boat / "sent.jsonl").read_text().splitlines()]
    with BLUEBOAT.open(newline="") as file:
        rows = sum(1 for _ in csv.DictReader(file))
    kinds = {kind: sum(item["kind"] == kind for item in sent) for kind in ("Fix", "Heading", "ImuSample")}
    assert kinds == {"Fix": 310, "Heading": rows, "ImuSample": rows}
    found = {
        "Fix": sum(len(frame.fixes) for frame in frames),
        "Heading": sum(len(frame.headings) for frame in frames),
        "ImuSample": sum(len(block.offset_us) for frame in frames for block in frame.imu),
    }
    assert found == kinds
    health = {report.sensor: report for frame in frames for report in frame.health}
    assert all(report.rejected == {} and report.discarded_bytes == 0 for report in health.values())
    assert read_log(run["log"]).damage is None
    replayed = command("wayfix", "replay", run["log"], "--json")
    counted = json.loads(replayed.stdout.splitlines()[-1])["estimates"]
    assert counted["equal"] == counted["recorded"] == counted["made"] > 0
