"""Finding the boat: the routes as the kernel writes them, the search without a clock, and real networks."""

import socket
import sys
import threading
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import LinkError
from shore.link import discovery as finding
from shore.link.discovery import MDNS, Candidate, Search, announced, find, gateways_v4, gateways_v6, known
from shore.link.known_boats import Boat
from tests.link.namespaces import MULTICAST, SIDES, Namespaces, what_is_missing
from tests.recordings import REPOSITORY

needs_namespaces = pytest.mark.skipif(what_is_missing() is not None, reason=what_is_missing() or "")

KEY = b"k" * 40
HEAD_V4 = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n"
ZERO = "0" * 32


def hex_v4(address: str) -> str:
    """As the kernel writes it: in the machine's byte order."""
    return f"{int.from_bytes(socket.inet_aton(address), sys.byteorder):08X}"


def route_v4(device: str, gateway: str, *, flags: str = "0003", metric: int = 0, target: str = "0.0.0.0") -> str:
    mask = "00000000" if target == "0.0.0.0" else "00FFFFFF"
    return f"{device}\t{hex_v4(target)}\t{hex_v4(gateway)}\t{flags}\t0\t0\t{metric}\t{mask}\t0\t0\t0\n"


def test_default_gateways_by_their_metric() -> None:
    table = HEAD_V4 + route_v4("eth0", "192.168.1.1", metric=600) + route_v4("wlan0", "10.42.0.1", metric=100)
    table += route_v4("wlan0", "10.0.0.7", target="10.9.9.0") + route_v4("tun0", "0.0.0.0", flags="0001")
    assert gateways_v4(table) == [("10.42.0.1", "wlan0"), ("192.168.1.1", "eth0")]


def test_default_gateways_of_ipv6() -> None:
    def line(gateway: str, flags: str, metric: str = "00000400", length: str = "00") -> str:
        return f"{ZERO} {length} {ZERO} 00 {gateway} {metric} 00000001 00000000 {flags}    wlan0\n"

    near, far = "fe80000000000000000000fffe000001", "fd000000000000000000000000000001"
    table = line(far, "00000003", "00000500") + line(near, "00450003") + line(ZERO, "00200200", "ffffffff")
    table += line(ZERO, "00000001") + line(far, "00000003", length="40")
    assert gateways_v6(table) == [("[fe80::ff:fe00:1%wlan0]", "wlan0"), ("[fd00::1]", "wlan0")]


@given(st.text())
def test_any_text_may_stand_where_routes_should(text: str) -> None:
    assert isinstance(gateways_v4(HEAD_V4 + text) + gateways_v6(text), list)


def test_addresses_of_paired_boats() -> None:
    boats = [Boat("springer", KEY, "10.0.0.1:5760"), Boat("otter", KEY, None)]
    assert known(boats) == [Candidate("10.0.0.1:5760", "last address of springer", "springer")]


def test_an_announcement_names_boat_and_addresses() -> None:
    info = SimpleNamespace(
        properties={b"boat": b"springer", b"other": None}, port=5761,
        parsed_scoped_addresses=lambda: ["fe80::1%wlan0", "10.0.0.1"],
    )  # fmt: skip
    assert announced(info) == [
        Candidate("10.0.0.1:5761", MDNS, "springer"), Candidate("[fe80::1%wlan0]:5761", MDNS, "springer"),
    ]  # fmt: skip
    info.properties = {}
    assert {candidate.boat_id for candidate in announced(info)} == {None}


A, B, SAME = (
    Candidate("10.0.0.1:5760", "last address of b"),
    Candidate("10.0.0.2", "gateway"),
    Candidate("10.0.0.1", MDNS),
)


def test_addresses_beyond_the_most_that_are_tried_are_counted() -> None:
    search = Search()
    for _ in range(2):
        for number in range(finding.MAX_CANDIDATES + 3):
            search.named(Candidate(f"10.0.0.{number}", MDNS))
    assert str(search.fault()).endswith(
        "and not tried, since these are 64: 3 more; join the boat's Wi-Fi, or give its address"
    )


def test_an_address_is_tried_once_whoever_names_it() -> None:
    search = Search()
    assert [search.named(candidate) for candidate in (A, B, SAME, B)] == [True, True, False, False]


def test_the_first_answer_wins() -> None:
    search = Search()
    for candidate in (A, B):
        search.named(candidate)
    search.answered(A, "timed out")
    assert not search.is_over
    search.answered(B, None)
    search.answered(A, None)
    assert search.is_over
    assert search.found is B


def test_it_is_over_when_all_is_tried_and_nobody_is_left_to_ask() -> None:
    search = Search()
    search.asking(MDNS)
    search.named(A)
    search.answered(A, "refused")
    assert not search.is_over
    search.asked(MDNS, "zeroconf is not installed")
    assert search.is_over


def test_everything_tried_stands_in_one_sentence() -> None:
    search = Search()
    search.asked("default gateway", "none is known")
    search.asking(MDNS)
    search.named(A)
    search.named(B)
    search.named(Candidate("not an address!", "last address of c"))
    search.answered(A, "Connection refused")
    assert str(search.fault()) == (
        "no boat was found within 5 s; tried: 10.0.0.1:5760 (last address of b: Connection refused), "
        "10.0.0.2 (gateway: no answer), not an address! (last address of c: not an address), "
        "default gateway (none is known), mDNS (no boat announces itself); join the boat's Wi-Fi, or give its address"
    )


STEPS = st.lists(st.tuples(st.sampled_from(["named", "yes", "no", "asked"]), st.integers(0, 5)), max_size=40)


@given(STEPS)
def test_whatever_comes_in_whatever_order(steps: list[tuple[str, int]]) -> None:
    search, tried, refused, yes = Search(), set[int](), set[int](), None
    search.asking(MDNS)
    is_asked = False
    for what, number in steps:
        candidate = Candidate(f"10.0.0.{number}", "x")
        if what == "named":
            assert search.named(candidate) == (number not in tried and yes is None)
            tried |= {number} if yes is None else set()
        elif what == "asked":
            search.asked(MDNS)
            is_asked = True
        elif number in tried:
            search.answered(candidate, None if what == "yes" else "no")
            refused |= {number} if what == "no" else set()
            yes = number if yes is None and what == "yes" else yes
        assert search.found == (None if yes is None else Candidate(f"10.0.0.{yes}", "x"))
        assert search.is_over == (yes is not None or (is_asked and refused == tried))
        assert all(f"10.0.0.{each} " in str(search.fault()) for each in tried)


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No gateway and no zeroconf: only what a test says."""
    monkeypatch.setattr(finding, "gateways", list)
    monkeypatch.setitem(sys.modules, "zeroconf", None)


def boats_at(*addresses: str) -> list[Boat]:
    return [Boat(f"b{number}", KEY, address) for number, address in enumerate(addresses)]


@pytest.mark.usefixtures("alone")
def test_a_dead_address_does_not_cost_the_others_time() -> None:
    is_over = threading.Event()

    def probe(candidate: Candidate, seconds: float) -> bool:
        assert 0 < seconds <= 5
        return is_over.wait(20) and False if candidate.address == "10.0.0.1" else True

    begin_s = time.monotonic()
    assert find(boats_at("10.0.0.1", "10.0.0.2"), probe).address == "10.0.0.2"
    assert time.monotonic() - begin_s < 2
    is_over.set()


@pytest.mark.usefixtures("alone")
def test_a_probe_that_hangs_is_not_waited_for() -> None:
    is_over = threading.Event()
    begin_s = time.monotonic()
    with pytest.raises(LinkError, match=r"10\.0\.0\.1 \(last address of b0: no answer\)"):
        find(boats_at("10.0.0.1"), lambda _candidate, _seconds: is_over.wait(20), limit_s=0.3)
    assert time.monotonic() - begin_s < 2
    is_over.set()


@pytest.mark.usefixtures("alone")
def test_refusals_are_told_in_the_probes_own_words_and_end_it_early() -> None:
    def probe(candidate: Candidate, _seconds: float) -> bool:
        if candidate.address == "10.0.0.1":
            raise LinkError("the boat does not know this station's key", "tcp://10.0.0.1:5760", "pair")
        if candidate.address == "10.0.0.2":
            raise ConnectionRefusedError(111, "Connection refused")
        return False

    begin_s = time.monotonic()
    with pytest.raises(LinkError) as raised:
        find(boats_at("10.0.0.1", "10.0.0.2", "10.0.0.3"), probe, limit_s=30)
    assert time.monotonic() - begin_s < 5
    for words in ("the boat does not know this station's key", "Connection refused", "not our boat", "not installed"):
        assert words in str(raised.value)


@pytest.mark.usefixtures("alone")
def test_candidates_come_without_a_probe_too() -> None:
    assert [candidate.address for candidate in finding.candidates(boats_at("10.0.0.1", "10.0.0.2"), 0.5)] == [
        "10.0.0.1", "10.0.0.2",
    ]  # fmt: skip


LISTENER = """
import socket
with socket.create_server(("10.77.0.1", 5760)) as server:
    print("ready", flush=True)
    while True:
        server.accept()[0].close()
"""
ANNOUNCER = """
import socket, time
from zeroconf import ServiceInfo, Zeroconf
info = ServiceInfo("_wayfix._tcp.local.", "b._wayfix._tcp.local.", 5760, properties={"boat": "springer"},
                   addresses=[socket.inet_aton("10.77.0.1")], server="b.local.")
Zeroconf(interfaces=["10.77.0.1"]).register_service(info)
print("ready", flush=True)
time.sleep(60)
"""
FINDER = """
import json, socket, sys, time
from common.errors import WayfixError
from shore.link.known_boats import Boat
from shore.link.discovery import find

def probe(candidate, seconds):
    host, _, port = candidate.address.partition(":")
    with socket.create_connection((host, int(port or 5760)), seconds):
        return True

boats = [Boat("dead", b"k" * 40, "10.77.0.200")]
begin, found, fault = time.monotonic(), None, None
try:
    found = find(boats, probe)
except WayfixError as error:
    fault = str(error)
took = time.monotonic() - begin
print(json.dumps({"found": found and [found.address, found.how, found.boat_id], "fault": fault, "took": took}))
"""


def start(net: Namespaces, program: str) -> None:
    started = net.popen("board", sys.executable, "-c", program, stdout=-1, text=True)
    assert started.stdout is not None
    assert started.stdout.readline() == "ready\n"


def found_in(net: Namespaces) -> tuple[dict[str, object], str]:
    import json

    done = net.run("shore", sys.executable, "-c", FINDER, cwd=REPOSITORY)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@needs_namespaces
def test_the_gateway_is_found_at_once_with_multicast_blocked() -> None:
    with Namespaces() as net:
        for side in SIDES:
            net.drop(side, MULTICAST)
        start(net, LISTENER)
        found, words = found_in(net)
        assert found["found"] == ["10.77.0.1", "gateway of wf0", None]
        assert float(str(found["took"])) < 2
        assert words == ""


@needs_namespaces
def test_within_five_seconds_it_is_told_that_nobody_is_there() -> None:
    pytest.importorskip("zeroconf", reason="zeroconf is not installed; pip install zeroconf")
    with Namespaces() as net:
        net.silence()
        found, words = found_in(net)
        assert 4.5 < float(str(found["took"])) < 6
        for said in ("10.77.0.200 (last address of dead:", "10.77.0.1 (gateway of wf0:", "mDNS (no boat announces"):
            assert said in str(found["fault"])
        assert words == ""


@needs_namespaces
def test_a_boat_that_is_not_the_gateway_is_found_by_its_announcement() -> None:
    pytest.importorskip("zeroconf", reason="zeroconf is not installed; pip install zeroconf")
    with Namespaces() as net:
        net.run("shore", "ip", "route", "delete", "default", check=True)
        start(net, LISTENER)
        start(net, ANNOUNCER)
        found, words = found_in(net)
        assert found["found"] == ["10.77.0.1:5760", "mDNS", "springer"]
        assert words == ""


def test_the_avahi_file_announces_what_is_looked_for() -> None:
    group = ET.parse(REPOSITORY / "deploy" / "avahi" / "wayfix.service").getroot()
    service = group.find("service")
    assert service is not None
    assert f"{service.findtext('type')}.local." == finding.SERVICE
    assert service.findtext("port") == "5760"
    assert (service.findtext("txt-record") or "").startswith("boat=")
    assert Path(REPOSITORY / "deploy" / "examples" / "springer.toml").exists()
