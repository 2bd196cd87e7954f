"""What the recipes add to a copy of the tree: the smallest code that does something."""

DRIVER = '''"""A compass that says only its heading: `H123.4`."""

from common.framer import Measurement
from common.messages import Heading
from common.boat_config import SensorTable
from common.simulation.readings import HeadingReading
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.encoder import Surroundings


class PlainDriver:
    """One such compass."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id

    def claims(self, line: Line) -> bool:
        return line.data.startswith(b"H")

    def feed(self, line: Line) -> Outcome:
        try:
            heading_deg = float(line.data[1:])
        except ValueError:
            return Rejected("not-a-number", self.sensor)
        heading = Heading(sensor=self.sensor, t_ns=line.t_ns, heading_mag_deg=heading_deg)
        return Accepted(self.sensor, "PLAIN", (heading,))

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
        return ()


class PlainEncoder:
    """What it prints."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        self._variation_deg = around.variation_deg

    def encode(self, t_s: float, reading: HeadingReading) -> bytes:
        return f"H{(reading.heading_true_deg - self._variation_deg) % 360.0:05.1f}\\n".encode("ascii")
'''

SPOKEN = """
from common.boat_config import SensorTable
from common.simulation.readings import HeadingReading
from onboard.devices import Surroundings, make_encoder
table = SensorTable(id="compass1", port="bow", role="compass", model="plain")
print(make_encoder(table, Surroundings(0, 2.0)).encode(0.0, HeadingReading(1.5)))
"""

SENTENCE = """

def _ths(text: Text) -> HeadingReading:
    return HeadingReading(heading_true_deg=fields.direction(text("heading")))


THS: Final[Form[Reading]] = Form(2, 2, _ths, names=("heading", "mode"))
"""

RULE = '''"""A measurement noise R that is twice what the boat's file says."""

from dataclasses import dataclass

from shore.navigation.noise.noise_rule import BeforeUpdate, Channel, ChannelNoise
from shore.navigation.numbers import Number


@dataclass(frozen=True, slots=True)
class Doubled(BeforeUpdate):
    """2 R0."""

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        return noise._replace(variance=2.0 * channel.initial_variance)
'''

FORMAT = '''"""A line of text for each estimate."""

from typing import BinaryIO

from shore.exports.track import ExportTrack, Row


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """The estimates. Raises OSError."""
    for item in track.items():
        if isinstance(item, Row):
            stream.write(b"here\\n")
'''

READER = '''"""Lines `place LAT LON`, one a second."""

from collections.abc import Iterator

from common.framer import Measurement
from common.messages import Fix
from common.boat_config import BoatTable, SensorTable
from shore.imports.line_counts import Account
from shore.imports.frames import PORT
from shore.imports.reader import ForeignRecord, Lines, Sources


class PlacesReader:
    """Reader of such a file."""

    def __init__(self, lines: Lines) -> None:
        self.account = Account("lines")
        self.accounts = (self.account,)
        self.boat = BoatTable(id="places")
        self.is_utc = False
        self.notes: list[str] = []
        self.sources = Sources()
        self._lines = lines

    def records(self) -> Iterator[ForeignRecord]:
        return (ForeignRecord(None, line.split()[1:]) for line in self._lines)

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        lat_deg, lon_deg = map(float, record.content)
        self.account.taken["place"] += 1
        yield Fix(sensor=self.sources.id_of("gps", ""), t_ns=t_ns, lat_deg=lat_deg, lon_deg=lon_deg)

    def leave_out(self, record: ForeignRecord, reason: str) -> None:
        self.account.rejected[reason] += 1

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        return self.sources.tables(PORT, rates_hz)
'''

COMMAND = '''"""`wayfix size`: how many bytes a log has."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """LOG."""
    parser.add_argument("log", type=Path)


def run(arguments: argparse.Namespace) -> int:
    """Say it."""
    print(arguments.log.stat().st_size)
    return 0
'''

SUBCOMMAND = '''"""`wayfix-onboard lines`: how many lines a recording has."""

import argparse
from pathlib import Path
from typing import Any


def add_arguments(commands: Any) -> None:
    """The subcommand."""
    lines = commands.add_parser("lines", help="count the lines of a recording")
    lines.add_argument("recording", type=Path)
    lines.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    print(len(arguments.recording.read_bytes().splitlines()))
    return 0
'''

ASKED = """
        async def sensors(_fields: dict[str, Any]) -> dict[str, Any]:
            return {"sensors": sorted(self._reopen)}
"""

ASKING = '''
def _sensors(arguments: argparse.Namespace) -> int:
    """The sensors of the running daemon."""
    print(*ask(runtime_of(arguments.runtime, os.environ), "sensors", ANSWER_S)["sensors"])
    return 0

'''

ANSWERED = """
import asyncio, threading
from pathlib import Path
from onboard.control.handlers import Commands
from onboard.control.socket import Control
from onboard.journal import Journal
from onboard.main import main

async def run():
    journal = Journal(print, lambda: 0)
    commands = Commands(dict, {"gps1": print, "imu1": print}, {}, journal)
    control = Control(Path("."), commands.handlers(), journal)
    serving = asyncio.create_task(control.run())
    await control.tried.wait()
    await asyncio.to_thread(main, ["sensors", "--runtime", "."])
    serving.cancel()

asyncio.run(run())
"""

SCENARIO = """    Scenario(
        name="there",
        group=OURS,
        text="straight to one buoy",
        mission=Mission(start=(0.0, 0.0), waypoints=((0.0, 60.0),), heading_deg=0.0),
        phases=(Phase(0.0, CALIBRATED),),
        assumed=told_right(CALIBRATED),
    ),
"""

WATCHER = '''"""Says how many frames there were."""

from typing import Any

from shore.watchers.watcher import Step, Watcher


class Counter(Watcher):
    """Counts."""

    def __init__(self) -> None:
        self.count = 0

    def take(self, step: Step) -> None:
        self.count += 1

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        print("counted", self.count)
'''
