"""A live run and the replay of its log: every estimate and event equal; in order of boat time nothing is worse."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
import pytest

from common.boat_config import BoatConfig
from common.clock_offset import ClockOffset
from common.codec import encode_frame
from common.events import event
from common.messages import Frame
from common.simulation.column_recording import recording_voyage
from common.simulation.readings import Rates
from common.simulation.scenarios import scenario_voyage
from common.simulation.voyage import Voyage
from shore.link.link import Link, Received, Wants
from shore.live.run import LiveRun, Options
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import log_at
from shore.navigation.estimate import Estimate
from shore.replay.run import Replay
from shore.settings.station import FilterSettings, StationSettings
from tests import offline
from tests.offline import frames_of
from tests.recordings import BLUEBOAT_235, BLUEBOAT_MAP
from tests.station.logs import without_none

UTC_NS = 1_795_000_000_000_000_000
RATES = Rates(gps_hz=1.0, compass_hz=5.0, imu_hz=20.0)

Item = Frame | BoatConfig
"""What comes over the link: a frame; or the link is silent and the board comes back with this configuration."""


SILENCES = 50
"""Looks at a silent link before the board greets anew: more than a second."""


class FakeLink:
    """Hands out frames as fast as they are taken."""

    def __init__(self, config: BoatConfig, items: Iterable[Item]) -> None:
        self._config = config
        self._items = list(items)
        self._silences = 0
        self.offset = ClockOffset()

    refusal = None

    def connect(self, *_: object, wants: Callable[[], object] = Wants, **_options: object) -> dict[str, Any]:
        self.wants = wants
        return self.greeting()

    def greeting(self) -> dict[str, Any]:
        boot_id = next((item.boot_id for item in self._items if isinstance(item, Frame)), "")
        config = without_none(asdict(self._config))
        return {"boot_id": boot_id, "next_seq": 0, "config": config, "runs": [[boot_id, 1, 0, 0]]}

    def receive(self, timeout_s: float) -> Received | None:
        self.wants()
        if self._silences:
            self._silences -= 1
            return None if self._silences else Received(connected=self.greeting())
        if not self._items:
            return Received(end={"sent": 0, "reason": "test"})
        item = self._items.pop(0)
        if isinstance(item, BoatConfig):
            self._config, self._silences = item, SILENCES
            return None
        return Received(frame=encode_frame(item))

    def ask_soon(self) -> None:
        pass

    def silent_s(self) -> float:
        return 4.0 if self._silences else 0.0


def live(
    directory: Path, config: BoatConfig, items: Iterable[Item], filters: Sequence[str], monkeypatch: pytest.MonkeyPatch
) -> Path:
    """The log of a real live run; its clock goes on by 50 ms with every look at the link."""
    now_ns = count(10**12, 25_000_000)
    monkeypatch.setattr("shore.live.run.boottime_ns", lambda: next(now_ns))
    link = cast("Link", FakeLink(config, items))
    options = Options(StationSettings(FilterSettings(tuple(filters))), log_dir=directory, until_end=True)
    run = LiveRun(link, options, lambda: False, lambda _line: None)
    run.run()
    assert run.log_path is not None
    return run.log_path


def check_equal(path: Path, least: int) -> Replay:
    """Every estimate and event of the log is found again, none is made that was not recorded."""
    run = Replay(path)
    for _ in run:
        pass
    assert run.comparison is not None
    assert run.comparison.first is None, str(run.comparison.first)
    estimates, events = run.comparison.estimates, run.comparison.events
    assert events is not None
    assert estimates.equal == estimates.recorded == estimates.made >= least
    assert events.equal == events.recorded == events.made >= 2
    assert not estimates.differs
    assert not events.differs
    return run


def test_scenario_53_is_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over the step of the noise at 300 s; the board's own events travel along."""
    voyage = scenario_voyage("5.3", seed=4, seconds=320.0, rates=RATES)
    frames = frames_of(voyage)
    for place in (50, 51, 2000):
        told = event("sensor-silent", frames[place].t0_ns, "gps1", sensor="gps1", age_s=3.0, reason="no line")
        board = event("client-left", frames[place].t0_ns, "link", client="page", reason="bye")
        frames[place] = replace(frames[place], events=(told, board))
    run = check_equal(live(tmp_path, voyage.config, frames, ["fuzzy"], monkeypatch), 3100)
    assert run.comparison
    assert run.comparison.events
    assert run.comparison.events.equal >= 8


def test_an_uncalibrated_boat_is_found_again_with_all_filters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    voyage = scenario_voyage("uncalibrated", seed=4, seconds=40.0, rates=RATES)
    filters = ["fuzzy", "fuzzy-thesis", "fuzzy-qr", "imm", "kf"]
    check_equal(live(tmp_path, voyage.config, frames_of(voyage), filters, monkeypatch), 5 * 380)


@pytest.mark.skipif(not BLUEBOAT_235.exists(), reason="the recordings of ../shared/data are not here")
def test_a_real_recording_is_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    voyage = recording_voyage(BLUEBOAT_235, BLUEBOAT_MAP, seed=1, seconds=60.0)
    check_equal(live(tmp_path, voyage.config, frames_of(voyage), ["fuzzy", "ukf"], monkeypatch), 2 * 580)


def test_late_shuffled_doubled_restarted_and_reconfigured_is_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    voyage = scenario_voyage("4.2", seed=4, seconds=90.0, rates=RATES)
    config, frames = voyage.config, frames_of(voyage)
    changed = replace(config, sensor=tuple(replace(sensor, sigma_m=9.0) for sensor in config.sensor))
    second = [replace(frame, boot_id="1" * 16, start_no=2, seq=frame.seq - 400) for frame in frames[400:650]]
    third = [replace(frame, boot_id="2" * 16, start_no=3, clock_id="c3", seq=frame.seq - 650) for frame in frames[650:]]
    items: list[Item] = [
        *shuffled(frames[:400], seed=1, most_s=20.0, share=0.2),
        *frames[100:110],  # once more
        config,  # the link is lost for a while, the board is the same
        *shuffled(second, seed=2, most_s=4.0, share=0.5),
        changed,
        *third,
        *second[30:40],  # of a clock that is no more
    ]
    path = live(tmp_path, config, items, ["fuzzy", "ukf"], monkeypatch)
    codes = {record["code"] for record in read_log(path).events()}
    assert {"link-lost", "link-restored", "config-changed", "late-dropped"} <= codes
    assert "daemon-restarted" in codes
    run = check_equal(path, 2 * 600)
    assert run.source.late > 20


def shuffled(frames: Sequence[Frame], seed: int, most_s: float, share: float) -> list[Frame]:
    """In order of arrival, where a share of the frames comes up to `most_s` late."""
    rng = np.random.default_rng(seed)
    delays = np.where(rng.random(len(frames)) < share, rng.uniform(0.0, most_s, len(frames)), 0.0)
    arrival = [frame.t1_ns + round(delay * 1e9) for frame, delay in zip(frames, delays, strict=True)]
    return [frames[place] for place in np.argsort(arrival, kind="stable")]


SEEDS = 20


def ratios(seed: int) -> tuple[float, float]:
    """RMS in order of boat time / RMS live, position and heading: a third of the frames up to a minute late."""
    voyage = offline.compensated(scenario_voyage("4.2", seed=seed, seconds=150.0, rates=RATES))
    with TemporaryDirectory() as directory:
        path = Path(directory) / "late.mcap"
        writer = log_at(path)
        connected = {"config": without_none(asdict(voyage.config))}
        writer.write_session({"kind": "start", "options": {"filters": ["fuzzy"]}, "connected": connected}, UTC_NS)
        for place, frame in enumerate(shuffled(frames_of(voyage), seed, 60.0, 0.35)):
            writer.write_frame(encode_frame(frame), frame, UTC_NS + place)
        writer.close()
        as_live, by_time = (errors(voyage, path, order) for order in ("arrival", "time"))
    return by_time.rms_m() / as_live.rms_m(), by_time.rms_deg() / as_live.rms_deg()


def errors(voyage: Voyage, path: Path, order: str) -> offline.Errors:
    estimates: list[Estimate] = [each for step in Replay(path, order=order) for each in step.output.estimates]
    return offline._errors(voyage, [each for each in estimates if each.aligned])


@pytest.mark.slow
def test_in_order_of_time_is_never_worse_than_live() -> None:
    found = np.array([ratios(seed) for seed in range(SEEDS)])
    rng = np.random.default_rng(1)
    medians = np.median(found[rng.integers(0, SEEDS, (2000, SEEDS))], axis=1)
    low, high = np.quantile(medians, (0.025, 0.975), axis=0)
    for place, what in enumerate(("position", "heading")):
        middle = float(np.median(found[:, place]))
        print(f"{what}: in order of time / live, median {middle:.3f} ({low[place]:.3f} to {high[place]:.3f})")
    assert high.max() < 1.0
