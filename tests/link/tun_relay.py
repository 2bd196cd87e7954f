"""A radio between two network namespaces: delay, jitter, reordering, loss, rate, silence, packet by packet. Root only.

    with Namespaces() as net, TunRelay(net) as radio:
        radio.loss, radio.delay_ms = 0.1, 150
        net.run("shore", ..., radio.address["board"])

Each namespace gets a TUN device `radio`; a thread here carries the packets over. It stands in for `tc netem`, which not
every kernel has. The numbers may be set at any time and hold for each way. What it does to which packet follows the
seed, but packets come when the kernel likes: tests compare with bounds.
"""

import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import threading
import time
from pathlib import Path
from typing import Final, Self

from tests.link.namespaces import SIDES, Namespaces, Side

DEVICE: Final = "radio"
_CLONE_NEWNET: Final = 0x4000_0000
_TUNSETIFF: Final = 0x4004_54CA
_IFF_TUN_NO_PI: Final = 0x1001


class TunRelay:
    """A context manager inside that of `Namespaces`."""

    def __init__(self, net: Namespaces, seed: int = 1) -> None:
        self.delay_ms = 0.0
        self.jitter_ms = 0.0
        """Up to so much more or less; packets may overtake each other by it."""
        self.reorder = 0.0
        """Share of packets that are not delayed: with a delay, they overtake."""
        self.loss = 0.0
        """Share of packets."""
        self.bits_per_s: float | None = None
        """Each way; None = all there is."""
        self.queue_bytes = 16_384
        """What waits for its turn before packets are thrown away, when there is a rate."""
        self.is_silent = False
        """All packets vanish, those on their way too."""
        self.carried: dict[Side, int] = dict.fromkeys(SIDES, 0)
        """Packets by the side that sent them; what was lost is not counted."""
        self.lost: dict[Side, int] = dict.fromkeys(SIDES, 0)
        self.address: dict[Side, str] = {"board": "10.78.0.1", "shore": "10.78.0.2"}
        self._net = net
        self._random = random.Random(seed)
        self._free_s: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
        self._due: list[tuple[float, int, Side, bytes]] = []
        self._numbers = itertools.count()
        self._is_over = False
        self._thread = threading.Thread(target=self._carry, name="radio", daemon=True)
        self._tun: dict[Side, int] = {}

    def __enter__(self) -> Self:
        try:
            for side in SIDES:
                self._tun[side] = _tun_in(self._net.name[side])
                shape = ("address", "add", f"{self.address[side]}/24", "dev", DEVICE)
                quiet = ("link", "set", DEVICE, "addrgenmode", "none")  # no IPv6, whose kernel talks by itself
                for words in (quiet, shape, ("link", "set", DEVICE, "up")):
                    self._net.run(side, "ip", *words, check=True)
        except BaseException:
            self._close()
            raise
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join()
        self._close()

    def _close(self) -> None:
        for tun in self._tun.values():
            os.close(tun)

    def _carry(self) -> None:
        side_of = {tun: side for side, tun in self._tun.items()}
        while not self._is_over:
            wait_s = self._due[0][0] - time.monotonic() if self._due else 0.05
            for tun in select.select(list(side_of), [], [], min(max(wait_s, 0.0), 0.05))[0]:
                self._take(side_of[tun], os.read(tun, 65_536))
            while self._due and self._due[0][0] <= time.monotonic():
                _, _, sender, packet = heapq.heappop(self._due)
                self._hand_over(sender, packet)

    def _take(self, sender: Side, packet: bytes) -> None:
        now_s, sent_s = time.monotonic(), time.monotonic()
        if self.is_silent or self._random.random() < self.loss:
            self.lost[sender] += 1
            return
        if self.bits_per_s is not None:
            begin_s = max(now_s, self._free_s[sender])
            if (begin_s - now_s) * self.bits_per_s / 8 > self.queue_bytes:
                self.lost[sender] += 1
                return
            sent_s = self._free_s[sender] = begin_s + len(packet) * 8 / self.bits_per_s
        late_ms = 0.0 if self._random.random() < self.reorder else self.delay_ms
        late_ms += self._random.uniform(-1, 1) * self.jitter_ms
        heapq.heappush(self._due, (sent_s + max(0.0, late_ms) / 1000, next(self._numbers), sender, packet))

    def _hand_over(self, sender: Side, packet: bytes) -> None:
        if self.is_silent:
            self.lost[sender] += 1
            return
        os.write(self._tun["shore" if sender == "board" else "board"], packet)
        self.carried[sender] += 1


def _tun_in(namespace: str) -> int:
    """A TUN device of a namespace, open here: a thread steps in, opens it and ends."""
    opened: list[int] = []

    def step_in() -> None:
        with Path(f"/run/netns/{namespace}").open("rb") as place:
            assert ctypes.CDLL(None).setns(place.fileno(), _CLONE_NEWNET) == 0
        tun = os.open("/dev/net/tun", os.O_RDWR)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH14x", DEVICE.encode(), _IFF_TUN_NO_PI))
        opened.append(tun)

    thread = threading.Thread(target=step_in)
    thread.start()
    thread.join()
    assert opened, f"no TUN device in {namespace}"
    return opened[0]
