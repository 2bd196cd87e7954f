"""The daemon and gpsd on the same bytes at the same time: processor time for each sentence.

    python -m benchmarks.beside_gpsd [--seconds 20] [--repeat 5] [--out FILE]

GPS 10 Hz (GGA, RMC, VTG, GSA), two compasses 20 Hz (HDG), AIS 50/s: 130 sentences/s, each written to a pseudo-terminal
of the daemon and to one of gpsd. No IMU, whose lines are not NMEA, and no third compass: Debian's gpsd takes four
devices. Each program has one client that takes all it sends: frames at 10 Hz, and gpsd's JSON. Without gpsd
(apt-get install gpsd) it says so; exit code 2.
"""

import argparse
import json
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from benchmarks.daemon_load import SETTLE_S, config_text
from benchmarks.feeder import GPS_FIELDS
from benchmarks.observer import Client, child, kilobytes, processor_ns
from common.clock import boottime_ns
from common.units import NS_PER_S

WARM_UP_S: Final = 6.0
"""Not counted: gpsd first tries baud rates and protocols."""
GOAL: Final = 3.0


@dataclass(frozen=True)
class Run:
    """One run; CPU in us for each sentence written while it was measured."""

    sentences: int
    wayfix_us: float
    gpsd_us: float
    wayfix_pss_mb: float
    gpsd_pss_mb: float
    wayfix_accepted: int
    """Over the whole run, of `sentences_in_all`."""
    sentences_in_all: int
    gpsd_ais: int
    """AIS reports gpsd gave out while it was measured, of `ais_sent`: did it read everything?"""
    ais_sent: int

    @property
    def ratio(self) -> float:
        return self.wayfix_us / self.gpsd_us


class GpsdClient:
    """Takes everything gpsd sends, in a thread; counts objects by class."""

    def __init__(self, port: int) -> None:
        self.classes: Counter[str] = Counter()
        self._socket = _connected(port)
        self._socket.sendall(b'?WATCH={"enable":true,"json":true};\n')
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        rest = b""
        while data := self._socket.recv(65_536):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                name = line[10:].partition(b'"')[0]  # {"class":"AIS",...
                self.classes[name.decode("ascii", "replace")] += 1


def _connected(port: int) -> socket.socket:
    deadline = time.monotonic() + 10
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > deadline:
                raise SystemExit("gpsd does not listen; does it take so many devices?") from None
            time.sleep(0.05)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def gpsd(program: str, paths: Sequence[str]) -> Iterator[tuple[int, GpsdClient]]:
    """Gpsd on these ports, read-only: its process and its client."""
    port = _free_port()
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([program, "-N", "-n", "-b", "-S", str(port), *paths], stdout=quiet, stderr=quiet)
    try:
        yield process.pid, GpsdClient(port)
    finally:
        process.terminate()
        process.wait(10)


def measure(program: str, seconds: float) -> Run:
    """Both at once, on the same bytes."""
    wayfix = str(Path(sys.executable).with_name("wayfix-onboard"))
    feeder = (sys.executable, "-m", "benchmarks.feeder", "--compasses", "2", "--twice")
    with tempfile.TemporaryDirectory() as place, child(*feeder) as devices:
        ready = devices.line()
        config = Path(place) / "boat.toml"
        config.write_text(config_text(ready["ports"]), encoding="utf-8")
        command = (wayfix, "run", "--open", str(config), "--bind", "tcp://127.0.0.1:*", "--until-stdin-closes")
        log = (Path(place) / "log").open("w", encoding="utf-8")
        with (
            log,
            child(*command, stderr=log) as daemon,
            gpsd(program, list(ready["twins"].values())) as (other, listener),
        ):
            pid = daemon.process.pid
            names = [*GPS_FIELDS, "ais1", *(name for name in ready["ports"] if name.startswith("compass"))]
            client = Client(daemon.line()["ready"]["bind"], names)
            devices.tell()
            client.listen(boottime_ns() + round(WARM_UP_S * NS_PER_S))
            begin_ns, before = boottime_ns(), (processor_ns(pid), processor_ns(other))
            ais = -listener.classes["AIS"]
            client.listen(begin_ns + round(seconds * NS_PER_S))
            end_ns, after = boottime_ns(), (processor_ns(pid), processor_ns(other))
            ais += listener.classes["AIS"]
            pss_kb = kilobytes(pid, "smaps_rollup", "Pss:"), kilobytes(other, "smaps_rollup", "Pss:")
            devices.tell()
            fed = devices.line()
            client.listen(boottime_ns() + round(SETTLE_S * NS_PER_S))
            client.close()
    sent = fed["sent"]
    count = sum(begin_ns <= t_ns < end_ns for times in sent.values() for t_ns in times)
    if fed["refused"] or fed["twins_refused"]:
        raise SystemExit(f"bytes were refused: {fed['refused']} by ours, {fed['twins_refused']} by gpsd's terminals")
    return Run(
        sentences=count,
        wayfix_us=(after[0] - before[0]) / 1000 / count,
        gpsd_us=(after[1] - before[1]) / 1000 / count,
        wayfix_pss_mb=pss_kb[0] / 1024,
        gpsd_pss_mb=pss_kb[1] / 1024,
        wayfix_accepted=sum(client.accepted.values()),
        sentences_in_all=sum(map(len, sent.values())),
        gpsd_ais=ais,
        ais_sent=sum(begin_ns <= t_ns < end_ns for t_ns in sent["ais1"]),
    )


def row_of(run: Run) -> str:
    cpu = f"{run.wayfix_us:.0f} | {run.gpsd_us:.0f} | {run.ratio:.2f}"
    counts = f"{run.wayfix_accepted} / {run.sentences_in_all} | {run.gpsd_ais} / {run.ais_sent}"
    return f"| {cpu} | {run.wayfix_pss_mb:.1f}, {run.gpsd_pss_mb:.1f} | {counts} |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="measured time of one run (default 20)")
    parser.add_argument("--repeat", type=int, default=5, help="runs (default 5)")
    parser.add_argument("--out", type=Path, help="write the JSON line there too")
    arguments = parser.parse_args()
    program = shutil.which("gpsd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        print(
            "gpsd is not installed: nothing to compare with; apt-get install --no-install-recommends gpsd",
            file=sys.stderr,
        )
        return 2
    print("| CPU us/sentence: wayfix | gpsd | ratio (goal <= 3) | PSS MB | accepted / sent | AIS out of gpsd / sent |")
    print("|---|---|---|---|---|---|", flush=True)
    runs = []
    for _ in range(arguments.repeat):
        run = measure(program, arguments.seconds)
        runs.append(run)
        print(row_of(run), flush=True)
    ratios = sorted(run.ratio for run in runs)
    medians = [statistics.median(getattr(run, name) for run in runs) for name in ("wayfix_us", "gpsd_us", "ratio")]
    words = f"ratio {medians[2]:.2f} [{ratios[0]:.2f}-{ratios[-1]:.2f}], {'met' if medians[2] <= GOAL else 'missed'}"
    print(f"median {medians[0]:.0f} us, {medians[1]:.0f} us, {words}")
    line = json.dumps({"benchmark": "beside_gpsd", "runs": [{**asdict(run), "ratio": run.ratio} for run in runs]})
    print(line)
    if arguments.out is not None:
        arguments.out.write_text(f"{line}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
