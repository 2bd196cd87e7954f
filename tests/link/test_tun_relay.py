"""The test tool `tun_relay` does what its name says: counted with UDP packets that are sent back."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import pytest

from common.clock import boottime_ns
from common.units import NS_PER_S
from tests.link.namespaces import Namespaces, what_is_missing
from tests.link.tun_relay import TunRelay

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(what_is_missing() is not None, reason=what_is_missing() or ""),
]

ECHO = """
import socket
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
    server.bind(("0.0.0.0", 7001))
    print("ready", flush=True)
    while True:
        data, sender = server.recvfrom(65536)
        server.sendto(data, sender)
"""
ASK = """
import json, socket, sys, time
address, count, size, gap_s = sys.argv[1], *map(float, sys.argv[2:])
trips, order = [], []
def hear(end, wait_s):
    end.settimeout(wait_s)
    try:
        number, sent = map(float, end.recv(65536).split()[:2])
    except TimeoutError:
        return False
    trips.append(time.monotonic() - sent)
    order.append(int(number))
    return True
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
    end.connect((address, 7001))
    begin = time.monotonic()
    for number in range(int(count)):
        end.send(f"{number} {time.monotonic()} ".encode().ljust(int(size)))
        due = begin + (number + 1) * gap_s
        while (left := due - time.monotonic()) > 0:
            hear(end, left)
    while hear(end, 1.0):
        pass
print(json.dumps({"trips": sorted(trips), "order": order, "took": time.monotonic() - begin - 1.0}))
"""


class Air:
    """Two namespaces, the radio between them and who answers on board."""

    def __init__(self, net: Namespaces, radio: TunRelay) -> None:
        self.net = net
        self.radio = radio
        server = net.popen("board", sys.executable, "-c", ECHO, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        assert server.stdout.readline() == "ready\n"

    def ask(self, count: int, size: int = 100, gap_s: float = 0.005) -> dict[str, Any]:
        numbers = (str(each) for each in (count, size, gap_s))
        done = self.net.run("shore", sys.executable, "-c", ASK, self.radio.address["board"], *numbers)
        assert done.returncode == 0, done.stderr
        return dict(json.loads(done.stdout))


@pytest.fixture
def air() -> Iterator[Air]:
    with Namespaces() as net, TunRelay(net) as radio:
        yield Air(net, radio)


def overtaken(order: list[int]) -> int:
    return sum(after < before for before, after in pairwise(order))


def test_as_it_comes_nothing_is_lost_late_or_out_of_order(air: Air) -> None:
    heard = air.ask(100)
    assert heard["order"] == list(range(100))
    assert heard["trips"][50] < 0.02
    assert air.radio.carried["shore"] >= 100
    assert air.radio.lost == {"board": 0, "shore": 0}


def test_delay_and_jitter(air: Air) -> None:
    air.radio.delay_ms, air.radio.jitter_ms = 150, 20
    trips = air.ask(100)["trips"]
    assert len(trips) == 100
    assert trips[0] >= 0.26
    assert 0.29 <= trips[50] <= 0.36
    assert trips[90] - trips[10] > 0.01


def test_loss(air: Air) -> None:
    air.radio.loss = 0.1
    assert 200 <= len(air.ask(300)["order"]) <= 280  # 243 are expected, both ways together
    assert air.radio.lost["shore"] > 0


def test_reordering(air: Air) -> None:
    air.radio.delay_ms, air.radio.reorder = 30, 0.2
    order = air.ask(300)["order"]
    assert sorted(order) == list(range(300))
    assert overtaken(order) > 30


def test_rate_and_what_a_full_queue_throws_away(air: Air) -> None:
    air.radio.bits_per_s = 400_000
    heard = air.ask(40, size=1_000, gap_s=0.0)
    assert 10 <= len(heard["order"]) <= 25  # of 16 kB that wait
    assert heard["trips"][-1] > 0.2
    air.radio.queue_bytes = 10**6
    heard = air.ask(100, size=1_000, gap_s=0.0)
    assert len(heard["order"]) == 100
    assert 1.9 <= heard["took"] <= 3.0  # 8 kbit each


def test_silence_swallows_what_is_on_its_way(air: Air) -> None:
    air.radio.delay_ms = 400
    with ThreadPoolExecutor() as threads:
        heard = threads.submit(air.ask, 20)
        deadline_ns = boottime_ns() + 10 * NS_PER_S
        while not air.radio._due and boottime_ns() < deadline_ns:
            time.sleep(0.01)
        air.radio.is_silent = True
        assert heard.result()["order"] == []
    assert air.radio.carried["shore"] == 0
    assert air.radio.lost["shore"] >= 20
    air.radio.is_silent = False
    assert len(air.ask(20)["order"]) == 20
