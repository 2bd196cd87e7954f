"""A babbling device: its surplus is thrown away and told once, the other port loses nothing."""

import os
import pty
import time
import tty
from contextlib import suppress
from pathlib import Path

from common.codec import decode_frame
from common.messages import Frame, Heading, SensorHealth
from shore.logbook.read import read_log
from tests.system.harness import Process, compass_config


def sentence(heading_deg: float) -> bytes:
    body = f"HCHDG,{heading_deg:.1f},,,,"
    checksum = 0
    for character in body.encode():
        checksum ^= character
    return f"${body}*{checksum:02X}\r\n".encode()


def headings(frames: list[Frame], sensor: str) -> list[Heading]:
    return [reading for frame in frames for reading in frame.headings if reading.sensor == sensor]


def newest(frames: list[Frame], sensor: str) -> SensorHealth:
    return [report for frame in frames for report in frame.health if report.sensor == sensor][-1]


def test_a_flooded_port_harms_no_other(tmp_path: Path) -> None:
    (loud, loud_slave), (calm, calm_slave) = pty.openpty(), pty.openpty()
    for slave in (loud_slave, calm_slave):
        tty.setraw(slave)
    os.set_blocking(loud, False)
    config = compass_config(tmp_path, loud=os.ttyname(loud_slave), calm=os.ttyname(calm_slave))
    daemon = Process("wayfix-onboard", "run", config)
    station = Process("wayfix", "connect", daemon.ready()["bind"], "--log", tmp_path / "log")
    try:
        station.wait_for_words("compass2")
        flood, sent = sentence(111.1) * 100, 0
        end = time.monotonic() + 4.0
        while time.monotonic() < end:
            sent += 1
            os.write(calm, sentence(sent % 360))
            with suppress(BlockingIOError):  # the pty is full: as loud as it can be
                os.write(loud, flood)
            time.sleep(0.01)
        daemon.wait_for_words("loud is within its byte budget again")
    finally:
        station.popen.terminate()
        station.finish()
        daemon.end()
        for descriptor in (loud, loud_slave, calm, calm_slave):
            os.close(descriptor)
    frames = [decode_frame(data) for data in read_log(next((tmp_path / "log").glob("*.mcap"))).frames()]
    assert [reading.heading_mag_deg for reading in headings(frames, "compass2")] == [
        k % 360 for k in range(1, sent + 1)
    ]
    kept = headings(frames, "compass1")
    # The budget of 2000 bytes/s, and one full read for the start.
    assert 50 < len(kept) * len(sentence(111.1)) < 5 * 2000 + 4096
    assert {reading.heading_mag_deg for reading in kept} == {111.1}
    assert newest(frames, "compass1").discarded_bytes > 100_000
    assert newest(frames, "compass2").discarded_bytes == 0
    assert sum("sends more than 2000 bytes/s" in line for line in daemon.err) == 1
