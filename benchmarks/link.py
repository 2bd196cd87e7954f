"""The link beside plain ZeroMQ PUB/SUB, and what a crowd of clients costs.

    python -m benchmarks.link crowd [--clients 100] [--seconds 20]    # one minute
    python -m benchmarks.link beside [--bytes 8750]                   # two minutes and a half
    python -m benchmarks.link stalled [--seconds 600]                 # memory beside clients that do not read

`crowd`: small clients in this process take 20 frames a second of 1.8 kB; processor time of the board (server, spool, no
sensors) with them and without, open and with keys. `beside`: the same frames go over the link and over a PUB socket at
once, each through a relay of its own, which cuts both for 10 s, and later lets 1 Mbit/s through for 60 s.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import zmq

from benchmarks.board import BOOT
from benchmarks.daemon_load import quantile, row
from benchmarks.observer import child, kilobytes, processor_ns
from benchmarks.stations import Listener, PlainSub, Small, Station, crowd
from common.clock import boottime_ns
from common.keys import new_keys
from common.units import NS_PER_S
from onboard.link.allow_list import READ, AllowList
from shore.link.transport import LinkKeys
from tests.link.relay import Relay

CROWD_BYTES: Final = 1_800
LIMIT_BITS_S: Final = 1_000_000
QUIET_S, CUT_S, AFTER_S, LIMITED_S, FREE_S = 8.0, 10.0, 15.0, 60.0, 40.0
SETTLE_S: Final = 5.0


@contextmanager
def board(*options: str, keys: int = 0) -> Iterator[tuple[Any, int, list[LinkKeys]]]:
    """What it said, its process, and the keys of as many stations."""
    with tempfile.TemporaryDirectory() as place:
        stations = []
        if keys:
            access = AllowList(Path(place))
            for number in range(keys):
                pair = new_keys()
                access.add(pair.public.decode("ascii"), f"station-{number}", READ)
                stations.append(LinkKeys(pair.public, pair.secret, access.public_key))
            options = (*options, "--keys")
        with child(sys.executable, "-m", "benchmarks.board", place, *options) as process:
            yield process.line(), process.process.pid, stations


def percent(pid: int, clients: list[Small], seconds: float) -> float:
    """Processor of the board, % of one core, while they listen."""
    before, began_ns = processor_ns(pid), boottime_ns()
    crowd(clients, BOOT, seconds)
    return 100 * (processor_ns(pid) - before) / (boottime_ns() - began_ns)


def crowd_figures(count: int, seconds: float, *, is_open: bool) -> dict[str, Any]:
    with (
        board("--bytes", str(CROWD_BYTES), keys=0 if is_open else count) as (ready, pid, keys),
        zmq.Context() as context,
    ):
        time.sleep(1.0)
        alone = percent(pid, [], min(10.0, seconds))
        clients = [
            Small(context, ready["bind"], f"{number:x}", None if is_open else keys[number]) for number in range(count)
        ]
        crowd(clients, BOOT, 5.0)
        before = [client.frames for client in clients]
        with_them = percent(pid, clients, seconds)
        came = [client.frames - was for client, was in zip(clients, before, strict=True)]
        rss_kb = kilobytes(pid, "status", "VmRSS:")
        for client in clients:
            client.socket.close()
    return {
        "clients": count, "keys": not is_open, "alone_percent": alone, "with_them_percent": with_them,
        "frames_each_per_s": [min(came) / seconds, max(came) / seconds], "rss_mb": rss_kb / 1024,
    }  # fmt: skip


def beside(size: int) -> dict[str, Any]:
    with board("--bytes", str(size), "--plain") as (ready, pid, _):
        link, plain = (Relay(("127.0.0.1", int(ready[name].rpartition(":")[2]))) for name in ("bind", "plain"))
        with link, plain:
            listeners: dict[str, Listener] = {
                "link": Station(link.address, ready).start(),
                "PUB/SUB": PlainSub(f"tcp://{plain.address}", ready).start(),
            }
            time.sleep(3.0)
            marks_s: list[float] = []
            rss_mb: list[float] = []
            for seconds, change in (
                (QUIET_S, lambda _: None),
                (CUT_S, Relay.cut),
                (AFTER_S, Relay.restore),
                (LIMITED_S, lambda relay: relay.limit(LIMIT_BITS_S)),
                (FREE_S, lambda relay: relay.limit(None)),
            ):
                change(link)
                change(plain)
                marks_s.append(boottime_ns() / NS_PER_S)
                time.sleep(seconds)
                rss_mb.append(kilobytes(pid, "status", "VmRSS:") / 1024)
            marks_s.append(boottime_ns() / NS_PER_S)
            for listener in listeners.values():
                listener.stop()
    return {
        "frame_bytes": size, "rss_mb": rss_mb,
        **{name: figures_of(listener, marks_s, ready) for name, listener in listeners.items()},
    }  # fmt: skip


def figures_of(listener: Listener, marks_s: list[float], ready: dict[str, Any]) -> dict[str, Any]:
    """marks_s: begin of quiet, cut, after, limited, free, and the end."""
    quiet, cut, after, limited, free, _ = marks_s
    seq = [int((t_s * NS_PER_S - ready["t0_ns"]) // ready["period_ns"]) for t_s in marks_s]
    ages = {
        "quiet": [round(ms * 1000) for _, ms in listener.live_ms(quiet, cut)],
        "limited": [round(ms * 1000) for _, ms in listener.live_ms(limited + SETTLE_S, free)],
    }
    first_s = min((t_s for t_s, ms in listener.live_ms(after, limited) if ms < 1000), default=None)
    late = [item.t_s for item in listener.arrivals if seq[3] <= item.seq < seq[4]]
    slope = statistics.linear_regression(*zip(*listener.live_ms(limited + SETTLE_S, free), strict=True)).slope
    return {
        "lost_in_cut": listener.lost(seq[0], seq[3] - 1),
        "lost_in_limit": listener.lost(seq[3], seq[4] - 1),
        "live_again_s": None if first_s is None else first_s - after,
        "last_of_limit_s": max(late, default=free) - free,
        "growth_ms_s": slope,
        **{f"{name}_{share}_ms": quantile(us, share / 100) / 1000 for name, us in ages.items() for share in (50, 99)},
    }


def say_beside(told: dict[str, Any]) -> None:
    names = (
        "lost_in_cut", "live_again_s", "quiet_50_ms", "quiet_99_ms", "limited_50_ms", "limited_99_ms", "growth_ms_s",
        "lost_in_limit", "last_of_limit_s",
    )  # fmt: skip
    print("\n".join((row(("figure", "link", "PUB/SUB")), row("---" for _ in range(3)))))
    for name in names:
        cells = [told[kind][name] for kind in ("link", "PUB/SUB")]
        print(row((name, *("-" if value is None else f"{value:.4g}" for value in cells))))
    rss_mb = ", ".join(f"{mb:.1f}" for mb in told["rss_mb"])
    print(f"board RSS, MB, at the end of quiet, cut, after, limited, free: {rss_mb}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("crowd", "beside", "stalled"))
    parser.add_argument("--clients", type=int, default=100)
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--bytes", type=int, default=8_750)
    given = parser.parse_args()
    if given.what == "crowd":
        for is_open in (True, False):
            print(json.dumps(crowd_figures(given.clients, given.seconds or 20.0, is_open=is_open)), flush=True)
    elif given.what == "beside":
        told = beside(given.bytes)
        say_beside(told)
        print(json.dumps(told))
    else:
        from tests.system import test_load_stalled as stalled

        stalled.SECONDS, stalled.GROWTH_KB = given.seconds or 600.0, 10_000
        with tempfile.TemporaryDirectory() as place:
            stalled.test_clients_that_stop_reading_cost_no_memory_and_no_frame_of_others(Path(place))


if __name__ == "__main__":
    main()
