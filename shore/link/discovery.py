"""Discovery (mDNS, default gateway, last address): finds the boat where no address was given.

Asked, all at once: where paired boats were last reached; the default gateway (the board is the access point of its own
Wi-Fi); who announces `_wayfix._tcp` by mDNS. Each address goes to a probe of its own thread, which says whether our
boat is there; the first yes wins, so a dead address costs the others nothing. After `LIMIT_S` it is over, also where
multicast is blocked.

`Search` is the pure part; `find` has the threads, `Announced` the library (zeroconf, optional).
"""

import logging
import queue
import socket
import struct
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv6Address
from pathlib import Path
from typing import Any, Final

from common.clock import boottime_ns
from common.errors import NoAnswerError, WayfixError
from common.units import NS_PER_S
from shore.link.known_boats import Boat
from shore.link.link import endpoint

LIMIT_S: Final = 5.0
SERVICE: Final = "_wayfix._tcp.local."
"""Service type that deploy/avahi/wayfix.service announces; its TXT record `boat` is the boat's id."""
MDNS: Final = "mDNS"
_ROUTES_V4: Final = Path("/proc/net/route")
_ROUTES_V6: Final = Path("/proc/net/ipv6_route")
_UP_AND_GATEWAY: Final = 0x3
_REJECT: Final = 0x200
MAX_CANDIDATES: Final = 64


@dataclass(frozen=True, slots=True)
class Candidate:
    """An address where a boat may be."""

    address: str
    """HOST or HOST:PORT, as `shore.link.link.endpoint` reads it."""
    how: str
    """Source of the address, in words: `last address of springer`, `gateway of wlan0`, `mDNS`."""
    boat_id: str | None = None
    """Id of the boat that the address is said to belong to; only a hint, because keys decide."""


Probe = Callable[[Candidate, float], bool]
"""Called with an address and a time limit, s; True = our boat is there, and a WayfixError is a no with its reason."""


class Search:
    """What was tried and what came of it; the caller brings addresses, answers and the end."""

    def __init__(self, limit_s: float = LIMIT_S) -> None:
        self.limit_s = limit_s
        self.found: Candidate | None = None
        self._untried: set[str] = set()
        """Addresses beyond the most that are tried."""
        self._tried: dict[str, tuple[Candidate, str | None]] = {}
        """Addresses by endpoint: the first source of each, and why our boat is not there (None = no answer yet)."""
        self._sources: dict[str, str | None] = {}
        """Sources of addresses: None = is still asked, empty = gave what it knows, else the reason why it gave
        nothing."""

    def asking(self, source: str) -> None:
        """A source that may name addresses later."""
        self._sources[source] = None

    def asked(self, source: str, why_nothing: str = "") -> None:
        """The source has named all it knows."""
        self._sources[source] = why_nothing

    def named(self, candidate: Candidate) -> bool:
        """Take an address; True = it is new and has to be tried."""
        try:
            place = endpoint(candidate.address)
        except WayfixError as error:
            self._tried[candidate.address] = candidate, error.what
            return False
        if self.found is not None or place in self._tried:
            return False
        if len(self._tried) >= MAX_CANDIDATES:
            self._untried.add(place)
            return False
        self._tried[place] = candidate, None
        return True

    def answered(self, candidate: Candidate, refusal: str | None) -> None:
        """What came of a try: None = our boat is there. The first one counts."""
        if refusal is not None:
            self._tried[endpoint(candidate.address)] = candidate, refusal
        elif self.found is None:
            self.found = candidate

    @property
    def is_over(self) -> bool:
        """Found, or nothing is left that could still bring it."""
        is_open = any(refusal is None for _, refusal in self._tried.values())
        return self.found is not None or not (is_open or None in self._sources.values())

    def fault(self) -> NoAnswerError:
        """One sentence that names everything tried."""
        tried = [
            f"{candidate.address} ({candidate.how}: {refusal or 'no answer'})"
            for candidate, refusal in self._tried.values()
        ]
        is_announced = any(candidate.how == MDNS for candidate, _ in self._tried.values())
        for source, why in self._sources.items():
            if why or (why is None and not is_announced):
                tried.append(f"{source} ({why or 'no boat announces itself'})")
        if self._untried:
            tried.append(f"and not tried, since these are {MAX_CANDIDATES}: {len(self._untried)} more")
        cure = "join the boat's Wi-Fi, or give its address"
        return NoAnswerError(f"no boat was found within {self.limit_s:g} s; tried: {', '.join(tried)}", "", cure)


def known(boats: Iterable[Boat]) -> list[Candidate]:
    """Addresses where paired boats were last reached."""
    return [Candidate(boat.address, f"last address of {boat.boat_id}", boat.boat_id) for boat in boats if boat.address]


def gateways_v4(table: str) -> list[tuple[str, str]]:
    """Default gateways (address, interface) in the text of /proc/net/route, best metric first."""
    found = []
    for line in table.splitlines()[1:]:
        with suppress(ValueError, struct.error):
            device, target, gateway, flags, _, _, metric, mask = line.split()[:8]
            if int(target, 16) == int(mask, 16) == 0 and int(flags, 16) & 0x203 == _UP_AND_GATEWAY:
                address = socket.inet_ntoa(struct.pack("=I", int(gateway, 16)))  # in the machine's byte order
                found.append((int(metric), address, device))
    return [(address, device) for _, address, device in sorted(found)]


def gateways_v6(table: str) -> list[tuple[str, str]]:
    """Default gateways (address with its zone, interface) in the text of /proc/net/ipv6_route, best metric first."""
    found = []
    for line in table.splitlines():
        with suppress(ValueError):
            target, length, _, _, gateway, metric, _, _, flags, device = line.split()
            is_default = int(target, 16) == int(length, 16) == 0
            if is_default and int(flags, 16) & (_REJECT | _UP_AND_GATEWAY) == _UP_AND_GATEWAY:
                address = IPv6Address(bytes.fromhex(gateway))
                zone = f"%{device}" if address.is_link_local else ""
                found.append((int(metric, 16), f"[{address}{zone}]", device))
    return [(address, device) for _, address, device in sorted(found)]


def gateways() -> list[Candidate]:
    """Default gateways of this machine; none where there is no /proc."""
    found: list[tuple[str, str]] = []
    for file, read in ((_ROUTES_V4, gateways_v4), (_ROUTES_V6, gateways_v6)):
        with suppress(OSError):
            found += read(file.read_text(encoding="ascii", errors="replace"))
    return [Candidate(address, f"gateway of {device}") for address, device in found]


class Announced:
    """Boats that announce themselves by mDNS; a thread of its own, so that import and start cost others no time."""

    def __init__(self, tell: Callable[[Candidate | str], None]) -> None:
        """tell: is given each boat, or once the reason why there will be none."""
        self._tell = tell
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="mdns", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def stop(self) -> None:
        """Ask no more; does not wait for the library's goodbye."""
        self._is_over.set()

    def _ask(self) -> None:
        try:
            from zeroconf import ServiceBrowser, ServiceStateChange, Zeroconf
        except ImportError:
            self._tell("not asked: zeroconf is not installed")
            return
        logging.getLogger("zeroconf").setLevel(
            logging.CRITICAL
        )  # a network without multicast is nothing to shout about

        def changed(zeroconf: Zeroconf, service_type: str, name: str, state_change: ServiceStateChange) -> None:
            if state_change is ServiceStateChange.Added and not self._is_over.is_set():
                info = zeroconf.get_service_info(service_type, name, timeout=1_500)
                for candidate in () if info is None else announced(info):
                    self._tell(candidate)

        try:
            zeroconf = Zeroconf()
            try:
                ServiceBrowser(zeroconf, SERVICE, handlers=[changed])
                self._is_over.wait()
            finally:
                zeroconf.close()
        except Exception as error:  # no network at all, multicast refused: what the library makes of it differs
            self._tell(f"cannot be asked: {error}")


def announced(info: Any) -> list[Candidate]:
    """The addresses of one announcement (zeroconf's ServiceInfo), IPv4 first."""
    boat = (info.properties or {}).get(b"boat") or b""
    boat_id = boat.decode("utf-8", "replace")[:64] or None
    addresses = sorted(info.parsed_scoped_addresses(), key=lambda address: ":" in address)
    return [
        Candidate(f"[{address}]:{info.port}" if ":" in address else f"{address}:{info.port}", MDNS, boat_id)
        for address in addresses
    ]


def candidates(boats: Iterable[Boat], limit_s: float = LIMIT_S) -> Iterator[Candidate]:
    """Addresses as they come, for `limit_s` at most; those on file and in the routes come at once."""
    yield from known(boats)
    yield from gateways()
    inbox: queue.SimpleQueue[Candidate | str] = queue.SimpleQueue()
    mdns = Announced(inbox.put)
    deadline_ns = boottime_ns() + round(limit_s * NS_PER_S)
    mdns.start()
    try:
        while (left_ns := deadline_ns - boottime_ns()) > 0:
            item = inbox.get(timeout=left_ns / NS_PER_S)
            if isinstance(item, str):
                return
            yield item
    except queue.Empty:
        return
    finally:
        mdns.stop()


def find(boats: Iterable[Boat], probe: Probe, limit_s: float = LIMIT_S) -> Candidate:
    """Address of our boat; raises LinkError that names everything tried.

    The probe is called from several threads at once, and one that lasts longer than it was given is not waited for.
    """
    inbox: queue.SimpleQueue[Candidate | str | tuple[Candidate, str | None]] = queue.SimpleQueue()
    search = Search(limit_s)
    deadline_ns = boottime_ns() + round(limit_s * NS_PER_S)

    def left_s() -> float:
        return max(0.0, (deadline_ns - boottime_ns()) / NS_PER_S)

    def attempt(candidate: Candidate) -> None:
        inbox.put((candidate, _refusal(probe, candidate, left_s())))

    def take(candidate: Candidate) -> None:
        if search.named(candidate):
            threading.Thread(target=attempt, args=(candidate,), daemon=True).start()

    mdns = Announced(inbox.put)
    search.asking(MDNS)
    mdns.start()
    try:
        for source, found in (("last addresses of paired boats", known(boats)), ("default gateway", gateways())):
            search.asked(source, "none is known" if not found else "")
            for candidate in found:
                take(candidate)
        while not search.is_over:
            item = inbox.get(timeout=left_s())
            if isinstance(item, str):
                search.asked(MDNS, item)
            elif isinstance(item, tuple):
                search.answered(*item)
            else:
                take(item)
    except queue.Empty:
        pass
    finally:
        mdns.stop()
    if search.found is None:
        raise search.fault()
    return search.found


def _refusal(probe: Probe, candidate: Candidate, seconds: float) -> str | None:
    """Why our boat is not there; None = it is."""
    try:
        return None if probe(candidate, seconds) else "not our boat"
    except WayfixError as error:
        return error.what
    except OSError as error:
        return error.strerror or type(error).__name__
