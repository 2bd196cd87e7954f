"""`wayfix-onboard virtual` as a process: what it says, what it leaves, how it stops."""

import csv
import json
import os
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.errors import WayfixError
from common.settings import read_toml
from common.simulation.motion import Truth
from common.simulation.scenarios import find_world, scenario_voyage
from common.simulation.voyage import boat_voyage
from onboard.devices.driver import Accepted, Line
from onboard.devices.registry import make_driver
from onboard.virtual import command
from onboard.virtual.boat_file import virtual_boat
from onboard.virtual.voyage import VoyageSource
from onboard.virtual.voyage_files import TruthFile

ROOT = Path(__file__).parents[2]
RUN = """
import argparse, sys
from onboard.virtual import command
parser = argparse.ArgumentParser()
command.add_arguments(parser.add_subparsers())
arguments = parser.parse_args(["virtual", *sys.argv[1:]])
sys.exit(arguments.command(arguments))
"""
FAST = ("--clock-rate", "16")


@contextmanager
def virtual(tmp_path: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, "--dir", str(tmp_path), *options],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def said(process: subprocess.Popen[str], word: str) -> dict[str, Any]:
    assert process.stdout
    line = process.stdout.readline()
    assert line, process.stderr and process.stderr.read()
    content: dict[str, Any] = json.loads(line)[word]
    return content


def tell(process: subprocess.Popen[str], text: str) -> None:
    assert process.stdin
    process.stdin.write(text)
    process.stdin.flush()


class Reader(threading.Thread):
    """Collects what a port says."""

    def __init__(self, path: str) -> None:
        super().__init__(daemon=True)
        self.fd = os.open(path, os.O_RDONLY | os.O_NOCTTY)
        assert not termios.tcgetattr(self.fd)[3] & (termios.ECHO | termios.ICANON)
        self.data = b""
        self.start()

    def wait_for(self, lines: int, real_s: float = 3.0) -> None:
        """The kernel hands the last bytes over in its own time, and a hang-up throws them away."""
        end = time.monotonic() + real_s
        while self.data.count(b"\n") < lines and time.monotonic() < end:
            time.sleep(0.005)

    def run(self) -> None:
        try:
            while data := os.read(self.fd, 4096):
                self.data += data
        except OSError:
            pass


def test_a_run_from_ready_to_done(tmp_path: Path) -> None:
    with virtual(tmp_path, "--seconds", "8", "--hold", "--seed", "5", *FAST) as process:
        ready = said(process, "ready")
        readers = {name: Reader(path) for name, path in ready["ports"].items()}
        assert not Path(ready["truth"]).exists()
        tell(process, "go\n")
        start_ns = said(process, "started")["t_ns"]
        done = said(process, "done")
        assert done == {"sent": {"gps1": 9, "compass1": 81, "imu1": 160}, "dropped_bytes": 0}
        assert process.poll() is None
        for name, lines in (("gps", 27), ("compass", 81), ("imu", 160)):
            readers[name].wait_for(lines)
        assert Path(ready["ports"]["gps"]).is_symlink()
        process.send_signal(signal.SIGTERM)
        assert process.wait(2.0) == 0
    assert start_ns % 1_000_000 == 0
    _check_truth(Path(ready["truth"]), start_ns)
    _check_lines(Path(ready["config"]), Path(ready["sent"]), readers)


def _check_truth(path: Path, start_ns: int) -> None:
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert ",".join(rows[0]) == "t_s,lat_deg,lon_deg,heading_true_deg,t_ns,east_m,north_m,v_east_m_s,v_north_m_s"
    assert len(rows) == 81
    assert [int(row["t_ns"]) for row in rows[:2]] == [start_ns, start_ns + 100_000_000]
    assert float(rows[0]["heading_true_deg"]) == pytest.approx(210.0)


def _check_lines(config_file: Path, sent_file: Path, readers: dict[str, Reader]) -> None:
    """Every measurement that was noted as sent is found by the daemon's drivers under the emitted configuration."""
    config = read_toml(config_file, BoatConfig)
    sent = [json.loads(line) for line in sent_file.read_text().splitlines()]
    for table in config.sensor:
        driver = make_driver(table)
        found: list[Any] = []
        for data in readers[table.port].data.splitlines():
            outcome = driver.feed(Line(0, data))
            assert isinstance(outcome, Accepted), (data, outcome)
            found += outcome.measurements
        found += driver.flush(10**18, 0)
        mine = [record for record in sent if record["sensor"] == table.id]
        kind = mine[0]["kind"]
        got = [item for item in found if type(item).__name__ == kind]
        assert len(got) == len(mine)
        for record, item in zip(mine, got, strict=True):
            for key in record.keys() - {"sensor", "t_ns", "kind"}:
                assert getattr(item, key) == pytest.approx(record[key], abs=1e-9), key


def test_no_truth_is_made_up_over_a_hole_of_the_reference(tmp_path: Path) -> None:
    stamps = np.array([0.2, 0.3, 0.4, 3.0, 3.1])
    columns = [stamps + k for k in range(5)]
    voyage = replace(scenario_voyage("5.3", seconds=1.0), truth=Truth(stamps, *columns))
    TruthFile(voyage).write(tmp_path / "truth.csv", 5_000_000_000)
    rows = list(csv.DictReader((tmp_path / "truth.csv").read_text().splitlines()))
    assert [row["t_s"] for row in rows] == ["0.200", "0.300", "0.400", "3.000", "3.100"]
    assert rows[3]["t_ns"] == "8000000000"


def test_every_key_of_the_configuration_is_written_out(tmp_path: Path) -> None:
    with virtual(tmp_path, "--seconds", "1", "--bind", "tcp://127.0.0.1:9999", "--hold") as process:
        config = read_toml(said(process, "ready")["config"], BoatConfig)
    assert config.link.bind == "tcp://127.0.0.1:9999"
    assert config.boat.variation_deg == -0.5
    gps, compass, imu = config.sensor
    assert (gps.sigma_m, gps.latency_ms, gps.rate_hz) == (6.5, 300.0, 1.0)
    assert (compass.sigma_deg, compass.rate_hz) == (0.5, 10.0)
    assert (imu.accel_density, imu.gyro_density_deg, imu.rate_hz) == (0.0039, 0.033, 20.0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_stop_it_at_once_with_exit_code_0(tmp_path: Path, number: signal.Signals) -> None:
    with virtual(tmp_path) as process:
        said(process, "ready")
        said(process, "started")
        began = time.monotonic()
        process.send_signal(number)
        assert process.wait(2.0) == 0
        assert time.monotonic() - began < 0.5
        assert process.stderr
        assert process.stderr.read() == ""
    assert not (tmp_path / "gps").is_symlink()


@pytest.mark.parametrize("options", [(), ("--hold",)])
def test_the_end_of_stdin_stops_it(tmp_path: Path, options: tuple[str, ...]) -> None:
    with virtual(tmp_path, "--until-stdin-closes", *options) as process:
        said(process, "ready")
        assert process.stdin
        process.stdin.close()
        assert process.wait(2.0) == 0
        assert process.stderr
        assert process.stderr.read() == "the parent is gone; the virtual boat stops\n"
        process.stdin = None


def test_faults_can_be_asked_for_on_stdin(tmp_path: Path) -> None:
    with virtual(tmp_path, "--until-stdin-closes", *FAST) as process:
        ports = said(process, "ready")["ports"]
        said(process, "started")
        tell(process, "unplug gps\nnonsense\n")
        assert process.stderr
        assert process.stderr.readline().startswith("not understood: 'nonsense'")
        assert not Path(ports["gps"]).exists()
        tell(process, "replug gps\nagain\n")
        process.stderr.readline()
        assert Path(ports["gps"]).exists()


def test_exit_at_end_and_list(tmp_path: Path) -> None:
    with virtual(tmp_path, "--seconds", "1", "--exit-at-end", *FAST) as process:
        assert process.wait(5.0) == 0
    with virtual(tmp_path, "--list") as process:
        assert process.stdout
        listed = {line.split(maxsplit=1)[0] for line in process.stdout.read().splitlines()}
        assert {"4.0", "4.4-T2", "5.3", "roadford", "tidal-outage"} <= listed
        assert process.wait(2.0) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--scenario", "9.9"], "no scenario '9.9'"),
        (["--recording", "none.csv"], "add --map"),
        (["--recording", "none.csv", "--map", "none.toml"], "none.toml: cannot be read"),
        (["--map", "none.toml"], "belongs to a recording"),
        (["--clock-rate", "0"], "--clock-rate: must be > 0"),
        (["--seconds", "-1"], "--seconds: must be > 0"),
        (["--boat", "none.toml"], "none.toml: cannot be read"),
        (["--boat", "none.toml", "--nmea", "none.log"], "--boat: belongs to a scenario"),
        (["--quirk", "gps1:x", "--recording", "none.csv"], "--quirk: belongs to a scenario"),
        (["--quirk", "gps1:x"], "--quirk: 'gps1:x' names no quirk"),
        (["--inject", "gps1 sterp 5 m at 1 s"], "--inject: there is no fault 'sterp', did you mean step?"),
        (["--inject", "gps1 stuck at 900 s", "--seconds", "5"], "--inject: 'gps1 stuck at 900 s' changes nothing"),
        (["--inject", "gps1 step 5 m at 1 s", "--nmea", "none.log"], "--inject: needs readings"),
        (["--scenario", "real-lake", "--seconds", "1e9"], "--seconds: real-lake is simulated for at most"),
    ],
)
def test_wrong_input_is_told_in_one_sentence(tmp_path: Path, options: list[str], words: str) -> None:
    import argparse

    parser = argparse.ArgumentParser()
    command.add_arguments(parser.add_subparsers())
    arguments = parser.parse_args(["virtual", "--dir", str(tmp_path), *options])
    with pytest.raises(WayfixError) as caught:
        arguments.command(arguments)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "gyro"', 'name = "../gyro"', "[[port]] '../gyro': a virtual port is a file beside boat.toml"),
        ('name = "kvh"', 'name = "truth.csv"', "[[port]] 'truth.csv': a virtual port is a file beside boat.toml"),
        ('model = "tcm2"', 'model = "tcm9"', 'no driver for role "compass" with model "tcm9"'),
        ("baud = 9600", "baud = fast", "is not valid TOML"),
    ],
)
def test_a_boat_that_cannot_be_simulated_is_one_sentence(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = (ROOT / "deploy" / "examples" / "springer.toml").read_text()
    assert old in text
    file = tmp_path / "boat.toml"
    file.write_text(text.replace(old, new).replace(old.replace("name", "port"), new.replace("name", "port")))
    with pytest.raises(WayfixError) as caught:
        virtual_boat(file)
    assert words in str(caught.value)


@pytest.mark.parametrize("seconds", [5.0, 30.0])
def test_a_port_that_is_too_slow_is_said_before_it_starts(seconds: float) -> None:
    slow = PortTable(name="a", path="a", baud=9600)
    imu = SensorTable(id="imu1", port="a", role="imu", model="arduimu", rate_hz=20.0)
    boat = BoatConfig(boat=BoatTable(id="b", variation_deg=0.0), port=(slow,), sensor=(imu,))
    (sentence,) = VoyageSource(boat_voyage(find_world("5.1"), boat, seconds=seconds)).overloads()
    assert sentence.startswith("a: 9600 baud carry ")
    fast = replace(boat, port=(replace(slow, baud=38400),))
    assert list(VoyageSource(boat_voyage(find_world("5.1"), fast, seconds=seconds)).overloads()) == []


def test_without_numpy_it_says_so_and_the_options_still_load() -> None:
    code = RUN.replace("import argparse, sys", "import argparse, sys; sys.modules['numpy'] = None")
    command_line = [sys.executable, "-c", code, "--list"]
    result = subprocess.run(command_line, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "WayfixError: wayfix-onboard virtual: numpy is missing; " in result.stderr
    assert "pip install '.[shore]'" in result.stderr
