"""Denial of service by peers of the link: the real daemon's memory, and another station's frames, beside each attack.

    python -m benchmarks.peers                      # every attack, 20 s each: some six minutes
    python -m benchmarks.peers parts-read --seconds 60

Daemon and attackers share this machine. The station has a key of its own and takes 20 frames/s; ages are from the end
of a frame to its arrival, on one clock. What each attack is: `ATTACKS` below, and benchmarks/README.md.
"""

import argparse
import json
import multiprocessing
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from benchmarks.daemon_load import quantile, row
from benchmarks.observer import child, kilobytes, processor_ns
from common.clock import boottime_ns
from common.codec import decode_frame
from common.keys import new_keys
from common.units import NS_PER_S
from onboard.link.allow_list import READ, AllowList
from shore.link.frame_ledger import Ledger
from shore.link.link import Link, Wants
from shore.link.transport import LinkKeys
from tests.link import floods

BOAT: Final = """[boat]
id = "benchmark"
[frames]
rate_hz = 20
[[port]]
name = "gps"
path = "{path}"
[[sensor]]
id = "gps1"
port = "gps"
role = "gps"
"""
PERIOD_S: Final = 0.05
HEAD: Final = (
    "attack", "sent MB", "RSS MB at most", "age p50 / p99 / longest s", "longest without a frame s", "lost",
    "joins after s", "journal lines", "board CPU %",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Attack:
    """What the attackers do."""

    peer: Callable[[floods.Target, int], floods.Peer]
    count: int = 1
    is_open: bool = False
    """The board has no keys, and the attackers are strangers."""
    is_revoked: bool = False
    """The attackers' keys are taken off the list two seconds after the begin."""
    bytes_per_s: float | None = None
    """Of all attackers together; None = as fast as it goes."""


ATTACKS: Final = {
    "nothing": Attack(floods.nobody, 0),
    "parts-read": Attack(floods.parts),
    "parts-revoked": Attack(floods.parts, is_revoked=True),
    "parts-open": Attack(floods.parts, is_open=True),
    "parts-open-4": Attack(floods.parts, 4, is_open=True),
    "small-parts-open": Attack(floods.small_parts, is_open=True),
    "small-parts-open-4": Attack(floods.small_parts, 4, is_open=True),
    "small-parts-read": Attack(floods.small_parts, 4),
    "slow-parts-open": Attack(floods.slow_parts, 20, is_open=True),
    "leases": Attack(floods.leases, 4, bytes_per_s=5e6),
    "hellos": Attack(floods.hellos, 4, bytes_per_s=5e6),
    "bad": Attack(floods.bad, 4, bytes_per_s=5e6),
    "commands": Attack(floods.commands, 4, bytes_per_s=5e6),
    "leases-open": Attack(floods.leases, 4, is_open=True),
    "bad-open": Attack(floods.bad, 4, is_open=True),
    "idle": Attack(floods.idle, 5000),
    "half-open": Attack(floods.half_open, 5000),
    "greeters-open": Attack(floods.greeters, 2000, is_open=True),
}


class Station:
    """One honest station in a thread of its own."""

    def __init__(self, address: str, keys: LinkKeys | None) -> None:
        self.ages_s: list[float] = []
        self.arrivals_s: list[float] = []
        self._ledger = Ledger()
        self._address, self._keys = address, keys
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def start(self) -> float:
        """Join; how long that took, s."""
        begun_s = time.monotonic()
        self._link = Link(self._address, keys=self._keys)
        greeting = self._link.connect(30.0, stream=True, wants=lambda: Wants(self._ledger.missing()))
        joined_s = time.monotonic() - begun_s
        self._ledger.greet(greeting["boot_id"], greeting["next_seq"], [])
        self._thread.start()
        return joined_s

    def stop(self) -> int:
        """Wait until nothing is missing, 5 s at most; how many frames are."""
        end_s = time.monotonic() + 5.0
        while self._ledger.missing_count and time.monotonic() < end_s:
            time.sleep(0.05)
        self._stop.set()
        self._thread.join(10)
        return self._ledger.missing_count

    def figures(self, began_s: float) -> dict[str, Any]:
        """Of the frames that came since then."""
        arrivals = [began_s, *(t_s for t_s in self.arrivals_s if t_s >= began_s)]
        ages_us = [round(age * 1e6) for t_s, age in zip(self.arrivals_s, self.ages_s, strict=True) if t_s >= began_s]
        return {
            "frames": len(ages_us),
            "age_p50_s": quantile(ages_us, 0.5) / 1e6,
            "age_p99_s": quantile(ages_us, 0.99) / 1e6,
            "age_longest_s": max(ages_us) / 1e6,
            "silent_s": max(b - a for a, b in pairwise(arrivals)),
        }

    def _work(self) -> None:
        while not self._stop.is_set():
            received = self._link.receive(0.05)
            if received is None or received.frame is None:
                continue
            frame, now_ns = decode_frame(received.frame), boottime_ns()
            is_newest = self._ledger.is_newest(frame.boot_id, frame.seq)
            if self._ledger.take(frame.boot_id, frame.seq, frame.seq) and is_newest:
                self.ages_s.append((now_ns - frame.t1_ns) / NS_PER_S)
                self.arrivals_s.append(now_ns / NS_PER_S)
            if self._ledger.has_hole:
                self._link.ask_soon()
        self._link.close()


@contextmanager
def daemon(place: Path, *options: str) -> Iterator[tuple[dict[str, Any], int]]:
    """What it said, and its process."""
    (place / "boat.toml").write_text(BOAT.format(path="/dev/ttyNONE"))
    program = str(Path(sys.executable).with_name("wayfix-onboard"))
    where = ("--bind", "tcp://127.0.0.1:*", "--state", str(place / "state"), "--runtime", str(place / "run"))
    command = (program, "run", *where, *options, str(place / "boat.toml"))
    with (place / "said").open("w") as said, child(*command, stderr=said) as process:
        try:
            yield process.line()["ready"], process.process.pid
        finally:
            process.process.terminate()


def run(attack: Attack, seconds: float) -> dict[str, Any]:
    """The figures of one attack."""
    with tempfile.TemporaryDirectory() as name:
        place, keys = Path(name), []
        if not attack.is_open:
            (place / "state").mkdir(mode=0o700)
            allowed = AllowList(place / "state")
            for number in range(1 + min(attack.count, 4)):
                pair = new_keys()
                allowed.add(pair.public.decode(), f"station-{number}", READ)
                keys.append(LinkKeys(pair.public, pair.secret, allowed.public_key))
        with daemon(place, *(["--open"] if attack.is_open else [])) as (ready, pid):
            return _Beside(attack, ready["bind"].removeprefix("tcp://"), keys, pid, place).run(seconds)


@dataclass
class _Beside:
    """A station beside an attack on one daemon."""

    attack: Attack
    address: str
    keys: list[LinkKeys]
    """The station's own, then the attackers'; none = an open board."""
    pid: int
    place: Path

    def run(self, seconds: float) -> dict[str, Any]:
        station = self._station()
        station.start()
        time.sleep(1.0)
        lines = self._lines()
        target = floods.Target(
            int(self.address.rpartition(":")[2]), self.keys[1:], self.attack.count, self.attack.bytes_per_s
        )
        spawn = multiprocessing.get_context("spawn")
        over, sent = spawn.Event(), spawn.Value("d", 0.0)
        attackers = spawn.Process(target=floods.attack, args=(self.attack.peer, target, over, sent), daemon=True)
        attackers.start()
        began_ns, began_cpu_ns = boottime_ns(), processor_ns(self.pid)
        rss_mb, joined_s = self._watch(began_ns / NS_PER_S, seconds)
        cpu = 100 * (processor_ns(self.pid) - began_cpu_ns) / (boottime_ns() - began_ns)
        over.set()
        attackers.join(20)
        lost = station.stop()
        return {
            "sent_mb": sent.value / 1e6, "rss_mb": rss_mb, "lost": lost, "joined_s": joined_s,
            "lines": self._lines() - lines, "cpu_percent": cpu, "seconds": seconds,
            **station.figures(began_ns / NS_PER_S),
        }  # fmt: skip

    def _watch(self, began_s: float, seconds: float) -> tuple[float, float | None]:
        """The most memory, MB, and how long another station needs to join half way, s."""
        rss_mb, joined_s, is_revoked = 0.0, None, False
        while (gone_s := boottime_ns() / NS_PER_S - began_s) < seconds:
            rss_mb = max(rss_mb, self._rss_mb())
            if self.attack.is_revoked and gone_s > 2.0 and not is_revoked:
                program = str(Path(sys.executable).with_name("wayfix-onboard"))
                command = (program, "revoke", "--runtime", str(self.place / "run"), "station-1")
                subprocess.run(command, check=True, capture_output=True)
                is_revoked = True
            if joined_s is None and gone_s > seconds / 2:
                other = self._station()
                joined_s = other.start()
                other.stop()
            time.sleep(0.01)
        return rss_mb, joined_s

    def _station(self) -> Station:
        return Station(self.address, self.keys[0] if self.keys else None)

    def _lines(self) -> int:
        return len((self.place / "said").read_text().splitlines())

    def _rss_mb(self) -> float:
        try:
            return kilobytes(self.pid, "status", "VmRSS:") / 1024
        except SystemExit as error:
            raise SystemExit(f"the daemon died:\n{(self.place / 'said').read_text()[-2000:]}") from error


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("attacks", nargs="*", metavar="ATTACK", help=f"one of {', '.join(ATTACKS)}; none = all")
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    if unknown := [name for name in given.attacks if name not in ATTACKS]:
        parser.error(f"no such attack: {', '.join(unknown)}")
    print("\n".join((row(HEAD), row("---" for _ in HEAD))), flush=True)
    told = {}
    for name in given.attacks or ATTACKS:
        told[name] = run(ATTACKS[name], given.seconds)
        of = told[name]
        ages = " / ".join(f"{of[f'age_{which}_s']:.3f}" for which in ("p50", "p99", "longest"))
        print(
            row((
                name, f"{of['sent_mb']:.0f}", f"{of['rss_mb']:.1f}", ages, f"{of['silent_s']:.2f}", str(of["lost"]),
                f"{of['joined_s']:.2f}", str(of["lines"]), f"{of['cpu_percent']:.0f}",
            )),
            flush=True,
        )  # fmt: skip
    print(json.dumps(told))


if __name__ == "__main__":
    main()
