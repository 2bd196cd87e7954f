"""Faults injected into a log: as if the boat had sailed with the broken sensor, and all else as it was."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.errors import WayfixError
from common.messages import Frame
from common.simulation.faults import with_faults
from common.simulation.scenarios import scenario_voyage
from common.simulation.without_ports import frames_of
from shore.imports.framed_recording import decoded
from shore.logbook.log_reader import read_log
from shore.main import main
from shore.replay.injection import Injection
from shore.watchers.watcher import Arrival, RunSeconds, Start
from tests.station.logs import log_of

VOYAGE = scenario_voyage("4.2", seconds=40.0)
FRAMES = tuple(frames_of(VOYAGE))


def injected(*texts: str) -> list[Frame]:
    """The frames of the healthy boat, spoilt as a log is."""
    injection, seconds, start = Injection(texts, VOYAGE.config), RunSeconds(), Start({}, VOYAGE.config)
    return [injection.spoil(Arrival(b"", frame, start, 0, seconds.at(frame))).frame for frame in FRAMES]


def values(frames: list[Frame]) -> Iterator[tuple[str, int, float]]:
    """Every number of the measurements that a fault may change, by its name and time."""
    for frame in frames:
        for fix in frame.fixes:
            for name in ("lat_deg", "lon_deg"):
                yield f"{fix.sensor}.{name}", fix.t_ns, getattr(fix, name)
            yield f"{fix.sensor}.utc_s", fix.t_ns, (fix.utc_ns or 0) % 10**12 / 1e9
        for heading in frame.headings:
            assert heading.heading_mag_deg is not None
            yield heading.sensor, heading.t_ns, heading.heading_mag_deg
        for block in frame.imu:
            for name in ("sum_accel_fwd_m_s", "sum_accel_stb_m_s", "sum_yaw_deg", "sum_time_s", "sum_count"):
                yield f"{block.sensor}.{name}", block.t_ns, getattr(block, name)
            for name in ("accel_fwd_m_s2", "accel_stb_m_s2", "yaw_rate_deg_s"):
                for t_ns, value in zip(block.sample_t_ns, getattr(block, name), strict=True):
                    yield f"{block.sensor}.{name}", t_ns, value


WITHIN = {"lat_deg": 2e-6, "lon_deg": 2e-6, "utc_s": 2e-3, "compass1": 0.11, "yaw_rate_deg_s": 0.07, "sum_yaw_deg": 1.0}
"""What a device's digits leave: the log's readings were rounded before the fault, those of the boat after it."""


@pytest.mark.parametrize(
    "text",
    [
        "gps1 step 50 m at 10 s for 5 s",
        "gps1 ramp 0.5 m/s toward 200 deg at 10 s",
        "gps1 stuck at 10 s for 9 s",
        "gps1 delay 3 s at 10 s",
        "gps1 clock 18 s at 10 s",
        "gps1 dropout at 10 s for 5 s",
        "compass1 step 30 deg at 10 s for 5 s",
        "compass1 stuck at 10 s",
        "imu1 sign at 0 s",
        "imu1 upside-down at 10 s",
        "imu1 turned 90 deg at 0 s",
        "imu1 step 2 deg/s at 10 s",
        "imu1 zero at 10 s for 3 s",
        "imu1 dropout at 10 s for 0.5 s",
    ],
)
def test_a_spoilt_log_is_the_log_of_a_spoilt_boat(text: str) -> None:
    sailed, spoilt = list(values(list(frames_of(with_faults(VOYAGE, [text]))))), list(values(injected(text)))
    assert [each[:2] for each in spoilt] == [each[:2] for each in sailed]
    for (name, t_ns, value), (_, _, right) in zip(spoilt, sailed, strict=True):
        within = WITHIN.get(name.removeprefix("gps1.").removeprefix("imu1."), 0.01)
        assert value == pytest.approx(right, abs=within), (name, t_ns)


def test_other_sensors_and_other_times_keep_every_bit() -> None:
    spoilt = injected("compass1 step 30 deg at 10 s for 5 s")
    assert [frame.headings for frame in spoilt] != [frame.headings for frame in FRAMES]
    for before, after in zip(FRAMES, spoilt, strict=True):
        assert (before.fixes, before.imu, before.clock_pairs) == (after.fixes, after.imu, after.clock_pairs)
        if not 9.5 <= (before.t0_ns - FRAMES[0].t0_ns) / 1e9 <= 15.5:
            assert before == after


def test_a_replay_with_faults_says_so_and_its_record_holds_them(
    tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    path, new = log_of(tmp_path, voyage[:300]), tmp_path / "new.mcap"
    fault = "compass1 step 40 deg at 15 s"
    assert main(["replay", str(path), "--inject", fault, "--record", str(new), "--json"]) == 0
    said = capsys.readouterr()
    summary = json.loads(said.out.splitlines()[-1])
    assert list(summary["injected"]) == [fault]
    assert f"injected: {fault} ({summary['injected'][fault]} readings changed)" in said.err + said.out
    assert summary["estimates"]["not_compared"] == "faults are injected that the live run did not have"
    start = next(record for record in read_log(new).session() if record["kind"] == "start")
    assert start["options"]["inject"] == [fault]
    before = [heading for frame in decoded(read_log(path).frames()) for heading in frame.headings]
    after = [heading for frame in decoded(read_log(new).frames()) for heading in frame.headings]
    off = [new_.heading_mag_deg != old.heading_mag_deg for old, new_ in zip(before, after, strict=True)]
    assert 0.3 < sum(off) / len(off) < 0.7
    assert main(["replay", str(new)]) == 0
    capsys.readouterr()


@pytest.mark.parametrize("text", ["imu1 turned 33 deg at 5 s", "imu1 noise x3 at 5 s", "gps1 noise 7 m at 5 s"])
def test_the_log_of_a_spoilt_replay_is_found_again(text: str, tmp_path: Path, voyage: list[Frame]) -> None:
    """What the filters saw is what is recorded: columns of an IMU are rounded on the wire."""
    path, new = log_of(tmp_path, voyage[:300]), tmp_path / "new.mcap"
    assert main(["replay", str(path), "--inject", text, "--record", str(new)]) == 0
    assert main(["replay", str(new)]) == 0


def test_a_fault_that_changes_nothing_is_said(
    tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(log_of(tmp_path, voyage[:40])), "--inject", "compass1 step 40 deg at 5000 s"]) == 0
    assert "--inject: 'compass1 step 40 deg at 5000 s' changes nothing; look at its time" in capsys.readouterr().err
    with pytest.raises(WayfixError, match="changes nothing"):
        with_faults(VOYAGE, ["gps1 step 5 m at 900 s"])


def test_a_fault_beyond_what_a_frame_carries_is_one_sentence() -> None:
    with pytest.raises(WayfixError, match=r"--inject: a fault gives what no frame can carry .*sog_kn.*smaller size"):
        injected("gps1 step 2000 m/s at 10 s")


def test_a_wrong_fault_is_one_sentence(tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]) -> None:
    path = log_of(tmp_path, voyage[:20])
    assert main(["replay", str(path), "--inject", "compass9 step 40 deg at 15 s"]) == 2
    assert "--inject: the boat has no sensor 'compass9', did you mean compass1?" in capsys.readouterr().err
