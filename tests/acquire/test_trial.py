import asyncio
import errno
import grp
import os
import pty
import select
import signal
import subprocess
import sys
import tty
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import pytest

from common.boat_config import BoatConfig, SensorTable
from common.settings import read_toml
from onboard import plausible
from onboard.config import _twice, load
from onboard.plausible import doubts
from onboard.reading.port_access import holders_of, owner_of, why_absent, why_busy, why_denied
from onboard.reading.trial import PortHeard, heard
from tests.acquire.sentences import GGA, RMC, sealed
from tests.cases import CASES, needs_cases

ARDUIMU = b"!!!VER:1.9,AN0:1,AN1:1,AN2:16,AN3:1,AN4:1,AN5:-4096,IMUH:253***\r\n"
EXAMPLES = Path(__file__).parents[2] / "deploy" / "examples"


@pytest.fixture
def terminals() -> Iterator[list[tuple[int, str]]]:
    """Three pseudo-terminals: the end to write to, and the path."""
    pairs = [pty.openpty() for _ in range(3)]
    for _, slave in pairs:
        tty.setraw(slave)
    yield [(master, os.ttyname(slave)) for master, slave in pairs]
    for pair in pairs:
        for descriptor in pair:
            os.close(descriptor)


def tried(config: BoatConfig, bursts: list[tuple[int, bytes]]) -> list[PortHeard]:
    """Listen for half a second, while each burst comes again and again."""

    async def both() -> list[PortHeard]:
        listening = asyncio.create_task(heard(config, 0.5))
        while not listening.done():
            for master, data in bursts:
                os.write(master, data)
            await asyncio.sleep(0.05)
        return await listening

    return asyncio.run(both())


@needs_cases
def test_swapped_ports(terminals: list[tuple[int, str]]) -> None:
    config = read_toml(CASES / "first-contact" / "swapped-ports.toml", BoatConfig)
    (imu, imu_path), (compass, compass_path), (gps, gps_path) = terminals
    paths = {"boat/imu": imu_path, "boat/compass": compass_path, "boat/gps": gps_path}
    config = replace(config, port=tuple(replace(port, path=paths[port.path]) for port in config.port))
    heading = sealed("HCHDG,101.1,,,,") + b"\r\n"
    found = tried(config, [(imu, ARDUIMU), (gps, GGA + b"\r\n" + RMC + b"\r\n"), (compass, heading)])
    said = {sensor.table.id: sensor.why for port in found for sensor in port.sensors}
    assert "lines like those of imu arduimu come; configured: gps nmea" in said["gps1"]
    assert "lines like those of gps nmea come; configured: imu arduimu" in said["imu1"]
    assert said["compass1"] == ""
    by_name = {port.table.name: port for port in found}
    assert by_name["compass"].samples == ("$HCHDG,101.1,,,,*43",) * 2
    assert by_name["compass"].readable == 1.0
    assert by_name["compass"].sensors[0].kinds["HDG"] > 2


@needs_cases
def test_wrong_units() -> None:
    told = "\n".join(doubts(load(CASES / "first-contact" / "wrong-units.toml")))
    for key in (
        "variation_deg", "gps1.rate_hz", "gps1.latency_ms", "gps1.sigma_m", "gps1.lever_fwd_m", "compass1.rate_hz",
        "compass1.sigma_deg", "imu1.accel_density", "imu1.gyro_density_deg", "imu1.bias_yaw_rate_deg_s",
    ):  # fmt: skip
        assert f"{key} = " in told
    assert "compass1.sigma_m = 5.0 has no effect: nothing reads it for the role compass" in told
    assert "imu1.deviation_deg = 3.0 has no effect: nothing reads it for the role imu" in told
    assert "sigma_deg = 0.0087 is unlikely (usual: 0.05 to 30); is it in radians?" in told


@pytest.mark.parametrize("name", ["boat.toml", "springer.toml"])
def test_the_examples_hold_nothing_unlikely(name: str) -> None:
    assert doubts(load(EXAMPLES / name)) == []


def test_who_holds_a_port_is_named_by_program_and_number(tmp_path: Path) -> None:
    port = "/dev/null"
    process = tmp_path / "4711"
    (process / "fd").mkdir(parents=True)
    (process / "fd" / "3").symlink_to(port)
    (process / "cmdline").write_bytes(b"/usr/bin/python3\0/usr/sbin/gpsd.py\0-n\0")
    assert [str(holder) for holder in holders_of(port, tmp_path)] == ["gpsd.py (pid 4711)"]
    assert why_busy(port, tmp_path) == "busy; gpsd.py (pid 4711) holds it"
    assert "fuser -v /dev/zero" in why_busy("/dev/zero", tmp_path)


def test_a_denied_port_is_told_by_its_cause(tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    port.chmod(0o660)
    other = max(entry.gr_gid for entry in grp.getgrall() if entry.gr_gid < 60_000) + 1
    if os.geteuid() == 0:
        os.chown(port, 0, other)
        assert f"sudo usermod -aG {other} root" in why_denied(str(port), errno.EACCES)
        assert owner_of(str(port)) == f"-rw-rw---- root:{other}"
    port.chmod(0o600)
    assert "a udev rule must let the group dialout" in why_denied(str(port), errno.EACCES)
    assert why_denied("/dev/null", errno.EPERM).endswith("DeviceAllow=char-mem rw")


def test_an_absent_port_is_told_with_those_that_are_there(tmp_path: Path) -> None:
    assert "only serial ports are read" in why_absent("tcp://10.0.0.1:10110")
    (tmp_path / "ttyUSB1").touch()
    there = f"no such device; there are {tmp_path}/ttyUSB1"
    assert why_absent(f"{tmp_path}/ttyUSB0", tmp_path) == there
    assert why_absent("boat/gps", tmp_path) == "no such device"


def test_listen_shows_the_lines_as_they_come_and_names_them(terminals: list[tuple[int, str]], tmp_path: Path) -> None:
    (master, path), *_ = terminals
    program = [str(Path(sys.executable).with_name("wayfix-onboard")), "listen", path, "--baud", "9600"]
    shown, said = tmp_path / "out", tmp_path / "err"
    with shown.open("w") as out, said.open("w") as err:
        listening = subprocess.Popen(program, stdout=out, stderr=err)
        try:
            for _ in range(100):
                os.write(master, sealed("HCHDG,101.1,,,,") + b"\r\n\x07ping\r\n")
                if said.stat().st_size or select.select([], [], [], 0.05)[0]:
                    break
            listening.send_signal(signal.SIGINT)
            assert listening.wait(5) == 0
        finally:
            listening.kill()
            listening.wait()
    assert set(shown.read_text(encoding="ascii").splitlines()) == {"$HCHDG,101.1,,,,*43", "\\x07ping"}
    assert said.read_text(encoding="ascii") == "read as compass nmea\n"


def test_two_adapters_alike_are_told_by_their_place(tmp_path: Path) -> None:
    by_id, by_path = tmp_path / "by-id", tmp_path / "by-path"
    for folder in (by_id, by_path):
        folder.mkdir()
    for number in (0, 1):
        (tmp_path / f"ttyUSB{number}").touch()
        (by_path / f"usb-1.{number}").symlink_to(tmp_path / f"ttyUSB{number}")
    (by_id / "usb-adapter").symlink_to(tmp_path / "ttyUSB1")
    device = str(tmp_path / "ttyUSB1")
    told = _twice(device, [str(by_id / "usb-adapter")] * 2, by_path)
    assert told.endswith(f"give each by its by-path name: {by_path}/usb-1.0, {by_path}/usb-1.1")
    assert "by-path" not in _twice(device, [device, device], by_path).replace(str(by_path), "")


def test_every_key_of_a_sensor_is_read_for_some_role() -> None:
    known = plausible.EVERY_ROLE.union(*plausible.READ.values())
    assert {item.name for item in fields(SensorTable)} == known
