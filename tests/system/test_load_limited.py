"""More frames than the link can carry: what is new comes in time all the same, and the rest when there is room."""

import math
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.board import FIX_EACH
from benchmarks.observer import child
from benchmarks.stations import Station
from common.units import NS_PER_S
from tests.link.relay import Relay

LIMIT_BITS_S = 1_000_000
FRAME_BYTES = 8_750
"""At 20 a second 1.4 Mbit/s."""
SECONDS = 40.0
SETTLE_S = 5.0
P99_MS = 1_000.0
"""Twice what is asked: the machine of the tests is busy."""
GROWTH_MS_S = 2.0
"""Of the age of live frames, at most, with 95 %. Where everything queues up it is 290."""
FILLED_S = 60.0


def now_s() -> float:
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def growth(live_ms: list[tuple[float, float]]) -> tuple[float, float]:
    """(slope in ms/s, half of its 95 % interval) of the medians of each second: neighbours are not independent."""
    t_s, ms = np.array(live_ms).T
    seconds = np.floor(t_s - t_s[0]).astype(int)
    x = np.unique(seconds)
    y = np.array([np.median(ms[seconds == second]) for second in x])
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    return float(slope), 1.96 * math.sqrt(covariance[0, 0])


@pytest.mark.in_pairs
@pytest.mark.slow
def test_live_frames_come_in_time_over_a_link_that_is_too_small_and_the_rest_later(tmp_path: Path) -> None:
    command = (sys.executable, "-m", "benchmarks.board", str(tmp_path), "--bytes", str(FRAME_BYTES))
    with child(*command) as board:
        ready = board.line()
        with Relay(("127.0.0.1", int(ready["bind"].rpartition(":")[2]))) as relay:
            relay.limit(LIMIT_BITS_S)
            station = Station(relay.address, ready)
            station.start()
            begun_s = now_s()
            time.sleep(SECONDS)
            live_ms, skipped = station.live_ms(begun_s + SETTLE_S, now_s()), station.missing
            first = min(item.seq for item in station.arrivals)
            last = int((now_s() * NS_PER_S - ready["t0_ns"]) // ready["period_ns"]) - 1
            relay.limit(None)
            lifted_s = now_s()
            while station.lost(first, last) and now_s() < lifted_s + FILLED_S:
                time.sleep(0.1)
            filled_s = now_s() - lifted_s
            fixes = [item for item in station.arrivals if item.seq % FIX_EACH == 0 and begun_s < item.t_s < lifted_s]
            station.stop()
    slope, half = growth(live_ms)
    ages_ms = sorted(ms for _, ms in live_ms)
    p50_ms, p99_ms = (ages_ms[int(share * len(ages_ms))] for share in (0.5, 0.99))
    print(
        f"\n  limited: live age p50 {p50_ms:.0f} ms, p99 {p99_ms:.0f} ms, grows {slope:.2f} +- {half:.2f} ms/s;"
        f" {len(live_ms)} live, {skipped} skipped so far, all here {filled_s:.1f} s after the limit was lifted"
    )
    assert station.lost(first, last) == 0
    assert skipped > 50  # the link was too small
    assert len(fixes) >= SECONDS - 1  # one a second: nothing bridges a fix, so its frame is not passed over
    assert max(item.late_s for item in fixes) <= P99_MS / 1000
    assert p99_ms <= P99_MS
    assert slope - half <= 0.0 or slope + half < GROWTH_MS_S
    assert slope + half < 10 * GROWTH_MS_S  # the interval says something
