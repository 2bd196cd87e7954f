"""Devices on pseudo-terminals, in a process of its own that notes when each line's first byte was written.

    python -m benchmarks.feeder [--compasses N] [--portion BYTES] [--twice] [--flood BYTES_PER_S]

First line of standard output: {"ports": {name: path}, "twins": the same once more, which get the same bytes}. The first
line on standard input starts the devices, the second stops them; then comes the log: {"sent": {stream: [t_ns, ...]},
"refused": writes a full pty took only in part, ...}.
The end of standard input ends the process, and the ports with it.
Line n of a stream carries n % MODULUS[stream] in one of its values, so that a reader can tell the lines apart.
"""

import argparse
import heapq
import json
import os
import random
import sys
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Final

from common.clock import boottime_ns
from common.units import NS_PER_MS, NS_PER_S

GPS_PERIOD_MS: Final = 100
IMU_PERIOD_MS: Final = 10
COMPASS_PERIOD_MS: Final = 50
AIS_PERIOD_MS: Final = 20
GPS_SENTENCE_MS: Final = 20
"""From one sentence of an epoch to the next."""
BAUD: Final = {"gps": 57_600, "imu": 230_400, "compass": 19_200, "ais": 38_400, "flood": 115_200}

GPS_FIELDS: Final = {"GGA": 9, "RMC": 7, "VTG": 5, "GSA": 15}
"""Where the sentence carries its number: altitude, speed, speed, PDOP."""
MODULUS: Final = {**dict.fromkeys(GPS_FIELDS, 5_000), "imu": 60_000, "compass": 3_600, "ais": 100_000}
FIRST_MMSI: Final = 230_000_000
IMU_FIRST_COUNT: Final = -30_000

_START: Final = datetime(2026, 11, 22, 8, tzinfo=UTC)
_FLOOD_STEP_S: Final = 0.01


def nmea(body: str) -> bytes:
    """A whole sentence."""
    return f"${body}*{reduce(xor, body.encode('ascii'), 0):02X}\r\n".encode("ascii")


def gps_line(formatter: str, n: int) -> bytes:
    """The sentence of epoch n."""
    number = n % MODULUS[formatter]
    utc = _START + timedelta(milliseconds=n * GPS_PERIOD_MS)
    clock = f"{utc:%H%M%S}.{utc.microsecond // 1000:03d}"
    place = f"60{n % 50_000 / 1000:07.4f},N,022{n % 40_000 / 1000:07.4f},E"
    match formatter:
        case "GGA":
            return nmea(f"GPGGA,{clock},{place},1,08,1.1,{number / 10:.1f},M,17.0,M,,0000")
        case "RMC":
            return nmea(f"GPRMC,{clock},A,{place},{number / 100:.2f},123.45,{utc:%d%m%y},,,A")
        case "VTG":
            return nmea(f"GPVTG,123.45,T,,M,{number / 100:.2f},N,9.26,K,A")
        case _:
            return nmea(f"GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,{number / 100:.2f},1.1,1.5")


def imu_line(n: int) -> bytes:
    """The number is the count of the forward accelerometer."""
    count = IMU_FIRST_COUNT + n % MODULUS["imu"]
    return (
        f"!!!VER:1.9,AN0:3,AN1:-7,AN2:{n % 400 - 200},AN3:{count},AN4:{n % 83},AN5:4096,"
        f"RLL:{n % 90 / 10:.2f},PCH:-1.25,YAW:{n % 3600 / 20:.2f},IMUH:253,TOW:0***\r\n"
    ).encode("ascii")


def compass_line(n: int) -> bytes:
    """The number is the heading in tenths."""
    return nmea(f"HCHDG,{n % MODULUS['compass'] / 10:05.1f},0.0,E,8.5,E")


def ais_line(n: int) -> bytes:
    """A position report of type 1; the number is in the ship's own, the MMSI."""
    bits = 1 << 162  # type, 6 of 168 bits; MMSI, speed, longitude, latitude, course and heading follow
    for value, end in (
        (FIRST_MMSI + n % MODULUS["ais"], 38),
        (52, 60),
        (22 * 600_000, 89),
        (60 * 600_000, 116),
        (1234, 128),
        (123, 137),
    ):
        bits |= value << 168 - end
    sixes = [bits >> 162 - 6 * place & 63 for place in range(28)]
    payload = "".join(chr(six + (48 if six < 40 else 56)) for six in sixes)
    return b"!" + nmea(f"AIVDM,1,1,,A,{payload},0")[1:]


def ais_number(sentence: str) -> int:
    """The line's number, from what `ais_line` made."""
    bits = 0
    for character in sentence.split(",")[5][:7]:
        code = ord(character) - 48
        bits = bits << 6 | (code - 8 if code > 40 else code)
    return (bits >> 4 & (1 << 30) - 1) - FIRST_MMSI


@dataclass(slots=True)
class Stream:
    """Lines of one kind on one port, at a fixed period."""

    name: str
    port: str
    period_ns: int
    phase_ns: int
    make: Callable[[int], bytes]
    sent_ns: list[int] = field(default_factory=list)


def streams(compasses: int, *, imu: bool) -> list[Stream]:
    """The standard load; where in a frame the devices begin is drawn anew for each run."""
    phases = (random.randrange(GPS_PERIOD_MS * NS_PER_MS) for _ in range(3 + compasses))
    gps_ns = next(phases)
    found = []
    for place, formatter in enumerate(GPS_FIELDS):
        phase_ns = gps_ns + place * GPS_SENTENCE_MS * NS_PER_MS

        def make(n: int, formatter: str = formatter) -> bytes:
            return gps_line(formatter, n)

        found.append(Stream(formatter, "gps", GPS_PERIOD_MS * NS_PER_MS, phase_ns, make))
    found.append(Stream("ais1", "ais", AIS_PERIOD_MS * NS_PER_MS, next(phases), ais_line))
    if imu:
        found.append(Stream("imu1", "imu", IMU_PERIOD_MS * NS_PER_MS, next(phases), imu_line))
    for number in range(1, compasses + 1):
        name = f"compass{number}"
        found.append(Stream(name, name, COMPASS_PERIOD_MS * NS_PER_MS, next(phases), compass_line))
    return found


class Ptys:
    """Master ends, with a slave end kept open, so that the raw mode stays."""

    def __init__(self, names: list[str], twice: bool = False) -> None:
        self.masters: dict[str, int] = {}
        self.paths: dict[str, str] = {}
        self.twins: dict[str, int] = {}
        self.twin_paths: dict[str, str] = {}
        for name in names:
            self.masters[name], self.paths[name] = self._opened()
            if twice:
                self.twins[name], self.twin_paths[name] = self._opened()
        self.twins_refused = 0

    @staticmethod
    def _opened() -> tuple[int, str]:
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        path = os.ttyname(slave)
        Path(path).chmod(0o666)  # gpsd opens it as a user of its own
        return master, path

    def write(self, name: str, data: bytes) -> int:
        """Bytes the terminal took."""
        if name in self.twins:
            self.twins_refused += self._write(self.twins[name], data) < len(data)
        return self._write(self.masters[name], data)

    @staticmethod
    def _write(master: int, data: bytes) -> int:
        try:
            return os.write(master, data)
        except BlockingIOError:
            return 0


def feed(ptys: Ptys, sources: list[Stream], stop: threading.Event, portion: int) -> int:
    """Write lines until `stop`, in portions of so many bytes (0 = whole); returns the writes a full pty refused."""
    refused = order = 0
    start_ns = boottime_ns() + 50 * NS_PER_MS
    due = [(start_ns + stream.phase_ns, number, stream, b"") for number, stream in enumerate(sources)]
    heapq.heapify(due)
    order = len(due)
    while not stop.is_set():
        due_ns, _, stream, rest = heapq.heappop(due)
        data = rest or stream.make(len(stream.sent_ns))
        part = data[:portion] if portion else data
        wait_ns = due_ns - boottime_ns()
        if wait_ns > 0:
            time.sleep(wait_ns / NS_PER_S)
        t_ns = boottime_ns()
        refused += ptys.write(stream.port, part) < len(part)
        order += 1
        if not rest:
            stream.sent_ns.append(t_ns)
            next_ns = start_ns + stream.phase_ns + len(stream.sent_ns) * stream.period_ns
            heapq.heappush(due, (next_ns, order, stream, b""))
        if len(part) < len(data):
            baud = BAUD[stream.port.rstrip("123456789")]
            heapq.heappush(due, (due_ns + len(part) * 10 * NS_PER_S // baud, -order, stream, data[len(part) :]))
    _finish_lines(ptys, due)
    return refused


def _finish_lines(ptys: Ptys, due: list[tuple[int, int, Stream, bytes]]) -> None:
    for _, _, stream, rest in sorted(due, key=lambda entry: entry[:2]):
        ptys.write(stream.port, rest)


def flood(ptys: Ptys, rate: int, stop: threading.Event) -> int:
    """Valid HDT lines, up to `rate` bytes/s; returns the bytes that went in."""
    text = b"".join(nmea(f"HEHDT,{n / 10:05.1f},T") for n in range(3_600))
    whole, portion = len(text), round(rate * _FLOOD_STEP_S)
    text += text[:portion]
    begin_s = time.monotonic()
    place = total = step = 0
    while not stop.is_set():
        step += 1
        left = portion
        while left and (taken := ptys.write("flood", text[place : place + left])):
            place, total, left = (place + taken) % whole, total + taken, left - taken
        time.sleep(max(0.0, begin_s + step * _FLOOD_STEP_S - time.monotonic()))
    return total


def _wait_for_line(stop: threading.Event) -> None:
    sys.stdin.readline()
    stop.set()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--compasses", type=int, default=1)
    parser.add_argument("--portion", type=int, default=0)
    parser.add_argument("--flood", type=int, default=0)
    parser.add_argument("--twice", action="store_true", help="every port twice, with the same bytes; without the IMU")
    arguments = parser.parse_args()
    sources = [] if arguments.flood else streams(arguments.compasses, imu=not arguments.twice)
    ptys = Ptys(
        ["flood"] if arguments.flood else list(dict.fromkeys(stream.port for stream in sources)), arguments.twice
    )
    print(json.dumps({"ports": ptys.paths, "twins": ptys.twin_paths}), flush=True)
    sys.stdin.readline()
    stop = threading.Event()
    threading.Thread(target=_wait_for_line, args=(stop,), daemon=True).start()
    log: dict[str, object] = {}
    begin_s = time.monotonic()
    before_s = time.process_time()
    if arguments.flood:
        log["bytes"] = flood(ptys, arguments.flood, stop)
    else:
        log["refused"] = feed(ptys, sources, stop, arguments.portion)
    log["twins_refused"] = ptys.twins_refused
    log["seconds"] = time.monotonic() - begin_s
    log["cpu_percent"] = 100 * (time.process_time() - before_s) / (time.monotonic() - begin_s)
    log["sent"] = {stream.name: stream.sent_ns for stream in sources}
    print(json.dumps(log), flush=True)
    sys.stdin.read()  # the ptys live until the last frames are read


if __name__ == "__main__":
    main()
