"""Resource leaks under churn: ports, links, SIGHUP, stations and floods come and go; descriptors and memory stay.

    python -m benchmarks.churn --minutes 30        # exit code 1 when they grew

A turn takes some 10 s. The first fifth of the turns is not counted: memory of Python and libzmq is taken once and kept.
"""

import argparse
import json
import os
import pty
import signal
import sys
import tempfile
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

from benchmarks.observer import child, kilobytes
from benchmarks.peers import BOAT
from common.keys import new_keys
from onboard.link.allow_list import READ, AllowList
from shore.link.link import Link
from shore.link.transport import LinkKeys
from tests.link import floods

LINE: Final = b"$GPGGA,120000.00,5046.0000,N,00116.0000,W,1,08,1.0,5.0,M,,M,,*54\r\n"
FLOODS: Final = (floods.parts, floods.leases, floods.bad, floods.hellos)
MOST_MB: Final = 5.0
"""Most growth of RSS, MB."""


@contextmanager
def port(link: Path) -> Iterator[int]:
    """A pseudo-terminal under a name; both are gone afterwards."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    link.symlink_to(os.ttyname(slave))
    try:
        yield master
    finally:
        link.unlink()
        os.close(slave)
        os.close(master)


def one_turn(pid: int, address: str, keys: LinkKeys, link: Path, number: int) -> None:
    """Everything that comes and goes, once."""
    place = int(address.rpartition(":")[2])
    with port(link) as master, ExitStack() as stack:
        for _ in range(20):
            os.write(master, LINE)
            time.sleep(0.1)
        stations = [Link(address, keys=keys) for _ in range(3)]
        for each in stations:
            stack.callback(each.close)
            each.connect(5.0, stream=True)
        os.kill(pid, signal.SIGHUP)
        flood = floods.Paced(FLOODS[number % len(FLOODS)](floods.Target(place, [keys]), 0), 20e6)
        stack.callback(flood.close)
        end_s = time.monotonic() + 2.0
        while time.monotonic() < end_s:
            with suppress(OSError):
                flood.step()
            for each in stations:
                each.receive(0.01)
        for peer in floods.crowd(place, 100):
            peer.close()
    time.sleep(1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    seconds = 60.0 * parser.parse_args().minutes
    samples: list[tuple[float, int, float]] = []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "boat.toml").write_text(BOAT.format(path=place / "gps"))
        program = str(Path(sys.executable).with_name("wayfix-onboard"))
        where = ("--bind", "tcp://127.0.0.1:*", "--state", str(place / "state"), "--runtime", str(place / "run"))
        said = (place / "said").open("w")
        pair = new_keys()
        (place / "state").mkdir(mode=0o700)
        allowed = AllowList(place / "state")
        allowed.add(pair.public.decode(), "churn", READ)
        keys = LinkKeys(pair.public, pair.secret, allowed.public_key)
        with said, child(program, "run", *where, str(place / "boat.toml"), stderr=said) as daemon:
            address, pid = daemon.line()["ready"]["bind"].removeprefix("tcp://"), daemon.process.pid
            begun_s = time.monotonic()
            while (gone_s := time.monotonic() - begun_s) < seconds:
                one_turn(pid, address, keys, place / "gps", len(samples))
                files = len(list(Path(f"/proc/{pid}/fd").iterdir()))
                samples.append((gone_s, files, kilobytes(pid, "status", "VmRSS:") / 1024))
                print(f"{gone_s:6.0f} s  {files} descriptors  {samples[-1][2]:.1f} MB", file=sys.stderr, flush=True)
            daemon.process.terminate()
        text = (place / "said").read_text()
    counted = samples[len(samples) // 5 :]
    files_grew = max(files for _, files, _ in counted[len(counted) // 2 :]) - max(
        files for _, files, _ in counted[: len(counted) // 2]
    )
    grew_mb = counted[-1][2] - counted[0][2]
    told = {
        "turns": len(samples), "descriptors_grew": files_grew, "rss_grew_mb": round(grew_mb, 2),
        "rss_mb": round(max(mb for *_, mb in samples), 1), "journal_lines": len(text.splitlines()),
        "tracebacks": text.count("Traceback"),
    }  # fmt: skip
    print(json.dumps(told))
    if files_grew > 0 or grew_mb > MOST_MB or told["tracebacks"]:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
