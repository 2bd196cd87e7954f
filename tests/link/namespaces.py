"""Two network namespaces joined by a virtual cable: `board` and `shore`, each a network of its own. Root only.

    with Namespaces() as net:
        daemon = net.popen("board", "wayfix-onboard", "run", ...)     # listens on 10.77.0.1
        net.silence()                                                 # packets vanish, nobody is told
        done = net.run("shore", "wayfix", "connect", net.address["board"])

The shore's default gateway is the board, as on the boat's own Wi-Fi. Everything started inside by `popen` is ended and
both namespaces are removed at the end, whatever happened; what a killed test left is removed by the next one.
Needs iproute2 and nftables. `tc netem` is not needed (and not to be had everywhere): delay, loss and reordering are
made by `tun_relay`.
"""

import itertools
import os
import shutil
import signal
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, Literal, Self

Side = Literal["board", "shore"]
SIDES: Final[tuple[Side, Side]] = ("board", "shore")
DEVICE: Final = "wf0"
MULTICAST: Final = "ip daddr 224.0.0.0/4"
"""For `drop`: mDNS and everything else that is sent to many."""
_PREFIX: Final = "wayfix"
_NUMBERS: Final = itertools.count()


def what_is_missing() -> str | None:
    """Why there are no namespaces here, in one sentence: for `pytest.mark.skipif`."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    for command, package in (("ip", "iproute2"), ("tc", "iproute2"), ("nft", "nftables")):
        if shutil.which(command) is None:
            return f"{command} is missing; apt-get install {package}"
    probe = f"{_PREFIX}-{os.getpid()}-probe"
    done = subprocess.run(["ip", "netns", "add", probe], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return f"this kernel makes no network namespaces here ({done.stderr.strip()})"
    _call("ip", "netns", "del", probe)
    return None


class Namespaces:
    """A context manager; its names hold the process id, so that tests may run beside each other."""

    def __init__(self) -> None:
        number = next(_NUMBERS)
        self.name: dict[Side, str] = {side: f"{_PREFIX}-{os.getpid()}-{number}-{side}" for side in SIDES}
        self.address: dict[Side, str] = {"board": "10.77.0.1", "shore": "10.77.0.2"}
        self._running: list[subprocess.Popen[Any]] = []
        self._cleaning = ExitStack()

    def __enter__(self) -> Self:
        remove_leftovers()
        with ExitStack() as cleaning:
            for side in SIDES:
                _call("ip", "netns", "add", self.name[side])
                cleaning.callback(_call, "ip", "netns", "del", self.name[side])
                self._ip(side, "link", "set", "lo", "up")
            cleaning.callback(self._end_all)
            far = ("peer", "name", DEVICE, "netns", self.name["shore"])
            _call("ip", "link", "add", "name", DEVICE, "netns", self.name["board"], "type", "veth", *far)
            for side in SIDES:
                self._ip(side, "address", "add", f"{self.address[side]}/24", "dev", DEVICE)
            self.link_up()
            self._cleaning = cleaning.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._cleaning.close()

    def run(
        self, side: Side, *command: str | Path, check: bool = False, timeout_s: float = 60, **options: Any
    ) -> subprocess.CompletedProcess[str]:
        """Run a command inside to its end; output as text. Options: those of `subprocess.run`."""
        options = {"capture_output": True, "text": True, **options}
        return subprocess.run(self.line(side, *command), check=check, timeout=timeout_s, **options)

    def popen(self, side: Side, *command: str | Path, **options: Any) -> subprocess.Popen[Any]:
        """Start a command inside; it is ended with the namespaces. Options: those of `subprocess.Popen`."""
        started = subprocess.Popen(self.line(side, *command), **{"start_new_session": True, **options})
        self._running.append(started)
        return started

    def line(self, side: Side, *command: str | Path) -> list[str]:
        """The command line that runs a command inside, for those who start it themselves."""
        return ["ip", "netns", "exec", self.name[side], *map(str, command)]

    def link_down(self) -> None:
        """As when the cable is drawn: both kernels know it at once, and forget routes over it."""
        self._ip("board", "link", "set", DEVICE, "down")

    def link_up(self) -> None:
        """The cable is in, both kernels have seen it, the shore's default gateway is the board."""
        for side in SIDES:
            self._ip(side, "link", "set", DEVICE, "up")
        deadline_s = time.monotonic() + 10
        for side in SIDES:
            while "LOWER_UP" not in self.run(side, "ip", "link", "show", DEVICE, "up", check=True).stdout:
                assert time.monotonic() < deadline_s, f"the cable of {self.name[side]} is dead"
                time.sleep(0.02)
        self._ip("shore", "route", "replace", "default", "via", self.address["board"])

    def drop(self, side: Side, match: str = "") -> None:
        """What arrives at this side vanishes, from now on: everything, or what an nftables expression matches."""
        device = "" if match else f'iifname "{DEVICE}"'
        chain = "type filter hook input priority 0; policy accept;"
        self._nft(side, f"add table inet {_PREFIX}")
        self._nft(side, f"add chain inet {_PREFIX} fault {{ {chain} }}")
        self._nft(side, f"add rule inet {_PREFIX} fault {device} {match} drop")

    def silence(self) -> None:
        """Everything vanishes both ways and nobody is told: a radio out of range."""
        for side in SIDES:
            self.drop(side)

    def speak(self) -> None:
        """The end of `drop` and `silence`."""
        for side in SIDES:
            self._nft(side, f"add table inet {_PREFIX}")
            self._nft(side, f"delete table inet {_PREFIX}")

    def limit(self, kbit_per_s: float | None, queue_ms: float = 400) -> None:
        """So much each way (`tbf`), with a queue of this length; None = all there is."""
        for side in SIDES:
            if kbit_per_s is None:
                self.run(side, "tc", "qdisc", "delete", "dev", DEVICE, "root")
                continue
            shape = ("rate", f"{kbit_per_s:g}kbit", "burst", "3200", "latency", f"{queue_ms:g}ms")
            _call(*self.line(side, "tc", "qdisc", "replace", "dev", DEVICE, "root", "tbf", *shape))

    def readdress(self, side: Side, address: str) -> None:
        """Another address of 10.77.0.0/24 for this side, as from a DHCP server that forgot; the former one is gone."""
        self._ip(side, "address", "add", f"{address}/24", "dev", DEVICE)
        self._ip(side, "address", "delete", f"{self.address[side]}/24", "dev", DEVICE)
        # The kernel drops the second address of a network with the first one.
        self._ip(side, "address", "replace", f"{address}/24", "dev", DEVICE)
        self.address[side] = address
        self.link_up()

    def _ip(self, side: Side, *words: str) -> None:
        _call("ip", "-netns", self.name[side], *words)

    def _nft(self, side: Side, statement: str) -> None:
        _call(*self.line(side, "nft", statement))

    def _end_all(self) -> None:
        for started in self._running:
            _end(started)
        self._running.clear()


def remove_leftovers() -> None:
    """Namespaces of tests whose process is gone."""
    done = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True)
    for line in done.stdout.splitlines():
        name = line.split()[0]
        words = name.split("-")
        if words[0] == _PREFIX and len(words) > 2 and not Path(f"/proc/{words[1]}").exists():
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def _end(started: subprocess.Popen[Any]) -> None:
    """A command and what it started, which shares its session."""
    if started.poll() is None:
        for number in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(started.pid, number)
                started.wait(5)
                break
            except ProcessLookupError:
                break
            except subprocess.TimeoutExpired:
                continue
    for stream in (started.stdin, started.stdout, started.stderr):
        if stream is not None:
            stream.close()


def _call(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr.strip()}"
