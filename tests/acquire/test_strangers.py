import importlib
import random
import re
import time
from collections.abc import Callable

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.framer import Identity
from common.framings import frames_in
from common.messages import Event
from common.settings import read_toml
from common.units import NS_PER_S
from onboard.devices import Line
from onboard.devices.foreign_text import format_of, name_of, text_seen
from onboard.devices.nmea_sentence import sentence_of
from onboard.devices.recognise import NOISE, stranger
from onboard.reading.acquisition import Acquisition
from onboard.reading.ubx_packets import UbxPackets
from tests.acquire.sentences import GGA, RMC, sealed
from tests.acquire.uart import heard_at
from tests.cases import CASES, needs_cases

SECONDS = 5

KNOWN = {
    "u-blox UBX": "B5 62 06 08 06 00 64 00 01 00 01 00 7A 12",
    "SiRF binary": "A0 A2 00 02 84 00 00 84 B0 B3",
    "SkyTraq binary": "A0 A1 00 02 02 01 03 0D 0A",
    "Garmin binary": "10 0A 02 26 00 CE 10 03",
    "RTCM 3 corrections": "D3 00 08 4C E0 00 8A 00 00 00 00 A8 F7 2A",
    "Swift SBP": "55 0B 02 D3 88 14 28 F4 7A 13 96 62 EE FF BE 40 14 00 F6 A3 09 00 00 00 0E 00 DB BF",
    "Xsens MT binary": "FA FF 30 00 D1",
    "MicroStrain MIP": "75 65 01 02 02 01 E0 C6",
    "BNO08x RVC binary": "AA AA DE 01 00 92 FF 25 08 8D FE EC FF D1 03 00 00 00 E7",
    "VectorNav binary": "FA 01 08 00 93 50 2E 42 83 3E F1 3F 48 B5 04 BB 92 88",
    "MAVLink 1": "FE 09 4E 01 01 00 00 00 00 00 02 03 51 04 03 1C 7F",
    "WitMotion binary (0x55)": "55 53 00 00 00 00 00 00 00 00 A8",
}
"""One frame of each as manuals and captures show it."""


def heard(port: PortTable, sensors: list[SensorTable], chunks: list[tuple[float, bytes]]) -> dict[str, str]:
    """Sensor -> why it does not deliver after these chunks (s, bytes); "" = it delivers."""
    told: list[Event] = []
    config = BoatConfig(boat=BoatTable(id="b"), port=(port,), sensor=tuple(sensors))
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, told.append)
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    for t_s, data in chunks:
        chain.chunk(data, round(t_s * NS_PER_S))
    now_ns = round(max(t_s for t_s, _ in chunks) * NS_PER_S)
    monitors = chain.monitors.values()
    return {
        item.table.id: "" if item.accepted else str(item.why_not(now_ns, chain.stranger(item))) for item in monitors
    }


def spoken(speak: Callable[[int], bytes], period_s: float) -> list[tuple[float, bytes]]:
    return [(n * period_s, speak(n)) for n in range(round(SECONDS / period_s))]


RIGHT = {
    "ubx": "u-blox UBX", "ubxrel": "u-blox UBX", "ubxmix": "", "sirf": "SiRF", "sbf": "SBF", "pubx": "PUBX,00",
    "ggk": "PTNL,GGK of Trimble", "nocs": "checksum", "rmconly": "", "ydraw": "NMEA 2000 raw", "ngt": "NGT-1",
    "mavgps": "MAVLink", "ths": "THS", "pashr": "PASHR", "avr": "PTNL,AVR of Trimble", "uniheading": "#UNIHEADINGA",
    "hdtnocs": "checksum", "hdtM": "checksum", "pfec": "PFEC,GPatt of Furuno", "wit": "WitMotion",
    "vn": "VNYMR of VectorNav", "xsens": "Xsens", "mip": "MIP", "bno": "what comes is text that no driver reads",
    "rvc": "BNO08x RVC", "mavimu": "MAVLink", "airmar": "", "furuno": "", "daisy": "", "mayara": "", "ttmsp": "",
}  # fmt: skip
"""Stream of the case -> what has to be said of it; "" = every sensor of the port delivers."""


@needs_cases
def test_many_sensors_each_stream_is_named_and_none_a_wrong_baud_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(CASES / "board")
    streams = importlib.import_module("streams").ALL
    config = read_toml(CASES / "board" / "many-sensors.toml", BoatConfig)
    wrong = {}
    for port in config.port:
        sensors = [sensor for sensor in config.sensor if sensor.port == port.name]
        why = heard(port, sensors, spoken(*streams[port.name]))
        assert "wrong baud rate" not in str(why)
        right = RIGHT[port.name]
        if not all(right in said if right else not said for said in why.values()):
            wrong[port.name] = why
    assert wrong == {}


SPEEDS = [
    (4800, 9600), (4800, 38400), (4800, 115200), (9600, 4800), (9600, 115200), (38400, 4800), (38400, 9600),
    (38400, 57600), (115200, 9600), (115200, 38400),
]  # fmt: skip


@pytest.mark.parametrize(("sent", "read"), SPEEDS)
def test_a_stream_at_a_wrong_speed_is_called_that(sent: int, read: int) -> None:
    burst = b"".join(
        sealed(text) + b"\r\n"
        for text in (
            "GPGGA,134601.00,5030.10000,N,00408.20000,W,1,09,0.9,5.0,M,50.0,M,,",
            "GPRMC,134601.00,A,5030.10000,N,00408.20000,W,3.2,84.4,231126,,,A",
            "GPVTG,84.4,T,,M,3.2,N,5.9,K,A",
        )
    )
    noise = heard_at(burst, sent, read)
    port = PortTable(name="p", path="/dev/none", baud=read)
    sensors = [SensorTable(id="gps1", port="p", role="gps"), SensorTable(id="compass1", port="p", role="compass")]
    why = heard(port, sensors, [(float(n), noise) for n in range(20)])
    assert all("wrong baud rate?" in said for said in why.values()), why


@pytest.mark.parametrize("name", KNOWN)
def test_a_frame_of_a_manual_is_known_by_its_form_and_its_checksum(name: str) -> None:
    frame = bytes.fromhex(KNOWN[name])
    (found,), left = frames_in(b"\x00\x07" + 4 * frame)
    assert found.framing.name == name
    assert found.count >= 3
    assert len(left) <= 2 + len(frame)
    damaged = bytearray(frame)
    damaged[-3] ^= 0x41
    assert name not in [item.framing.name for item in frames_in(4 * bytes(damaged))[0]]


@given(st.binary(max_size=4096))
def test_noise_has_no_name(data: bytes) -> None:
    table = SensorTable(id="gps1", port="p", role="gps")
    assert frames_in(data)[0] == []
    found = stranger(table, data, [Line(0, item) for item in data.split(b"\n")])
    assert found in (None, NOISE) or data.isascii()


@pytest.mark.parametrize(
    ("line", "name"),
    [
        (b"$GNTHS,84.40,A*07", "THS"),
        (b"$PASHR,134601.00,84.40,T*00", "PASHR"),
        (b"$PTNL,AVR,134601.00*00", "PTNL,AVR"),
        (b"$PUBX,00,134601.00*00", "PUBX,00"),
        (b"$PFEC,GPatt,84.4*00", "PFEC,GPatt"),
        (b"$VNYMR,+084.4*00", "VNYMR"),
        (b"$PTNTHPR,1,N*00", "PTNTHPR"),
        (b"hello", ""),
    ],
)
def test_a_sentence_has_a_name(line: bytes, name: str) -> None:
    assert name_of(line) == name


@pytest.mark.parametrize(
    ("line", "name"),
    [
        (b"17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70", "NMEA 2000 raw (Yacht Devices RAW)"),
        (b"A173321.107 23FF7 1F513 012F3070002F30709F", "NMEA 2000 raw (Actisense N2K ASCII)"),
        (b"2011-11-24-22:42:04.388,2,127251,36,255,8,7d,0b,7d,02,00,ff,ff,ff", "NMEA 2000 raw (canboat)"),
        (b"(1436509052.249713) can0 09F8027F#50FF12030000FFFF", "CAN bus frames (candump)"),
        (b"T09F8027F850FF12030000FFFF", "CAN bus frames (SLCAN)"),
        (b"#UNIHEADINGA,97,GPS,FINE,2190,365174000;SOL_COMPUTED,NARROW_INT*0badf00d", "Unicore or NovAtel ASCII"),
        (b"#YPR=84.40,-1.19,0.81", "text of a Razor AHRS"),
        (b'{"class":"TPV","lat":50.5}', "JSON"),
        (b"+CREG: 0,1", "answers of a modem"),
        (b"Debian GNU/Linux 12 boat ttyS0", "the console of a computer"),
        (b"1.0, -2.5, 9.81", "columns of numbers"),
        (b"Orientation: 84.40, -1.19, 0.81", "text"),
    ],
)
def test_a_line_of_text_has_a_format(line: bytes, name: str) -> None:
    assert format_of(line) == name


@given(
    st.lists(st.sampled_from([b" ", b"0", b",", b"-", b".", b"*", b"$", b"A", b"\\", b"["]), min_size=1, max_size=3),
    st.sampled_from([b"", b"12.5", b"$GPGGA,", b"#A,", b"\xff", b"\\s:", b"<", b"["]),
    st.sampled_from([b"", b"m", b"\xff", b"*"]),
)
@example([b" "], b"12.5", b"m")
@settings(max_examples=40)
def test_no_line_takes_long_to_look_at(pieces: list[bytes], begin: bytes, end: bytes) -> None:
    """A pattern that tries every way of dividing blanks needs seconds at 24 of them, and for ever at 4,096."""
    for count in (12, 24, 4_096 // len(pieces)):
        data = begin + b"".join(pieces) * count + end
        started = time.process_time()
        format_of(data), name_of(data), sentence_of(data), text_seen([data]), UbxPackets().text(data, 0)
        assert time.process_time() - started < 0.2


def test_packets_of_an_unknown_protocol_are_noticed_by_their_length_or_checksum() -> None:
    chance = random.Random(5)
    counted = b"".join(
        b"\xc3\x5a" + bytes([1, size]) + chance.randbytes(size) for size in (chance.randrange(9, 60) for _ in range(30))
    )
    summed = b"".join(
        packet + bytes([sum(packet) & 0xFF]) for packet in (b"\xc3\x5a" + chance.randbytes(20) for _ in range(30))
    )
    table = SensorTable(id="gps1", port="p", role="gps")
    for data in (counted, summed):
        found = stranger(table, data, [])
        assert found is not None
        assert "that is not known here, each with c3 5a before it" in found.what
    spoiled = b"".join(b"\xc3\x5a" + chance.randbytes(21) for _ in range(30))
    assert stranger(table, spoiled, []) is NOISE


def test_seven_bits_with_parity_are_told_apart_from_a_wrong_speed() -> None:
    line = sealed("HCHDG,101.1,,,,") + b"\r\n"
    even = bytes(byte | (byte.bit_count() & 1) << 7 for byte in line)
    port, sensor = PortTable(name="p", path="/dev/none"), SensorTable(id="compass1", port="p", role="compass")
    why = heard(port, [sensor], [(n / 10, even) for n in range(40)])["compass1"]
    assert re.search(r"7 bits and parity.*8N1", why)


SHIP = b"!AIVDM,1,1,,A,B3KLehP0B@LTN6`Vl;rrBE063P06,0*5A\r\n"


def test_an_ais_receiver_whose_port_brings_another_device_is_told_once() -> None:
    told: list[str] = []
    acquisition = listening_for_ships(told)
    run(acquisition, range(1, 60), GGA + b"\r\n" + RMC + b"\r\n")
    silent = "ais1 is silent for 31 s: lines like those of gps nmea come; configured: ais nmea"
    assert told[1:] == [silent]
    assert acquisition.monitors["ais1"].state(60 * NS_PER_S)[0] == "silent"
    run(acquisition, range(60, 61), SHIP)
    assert told[2:] == ["ais1 delivers"]


def test_an_ais_receiver_that_heard_a_ship_may_hear_none_while_its_port_brings_a_position_too() -> None:
    told: list[str] = []
    acquisition = listening_for_ships(told)
    run(acquisition, range(1, 2), SHIP)
    run(acquisition, range(2, 90), GGA + b"\r\n" + GGA[:30] + b"\r\n")
    assert not any("ais1" in text for text in told[1:])
    assert acquisition.monitors["ais1"].state(90 * NS_PER_S)[0] == "delivering"


def listening_for_ships(told: list[str]) -> Acquisition:
    config = BoatConfig(
        boat=BoatTable(id="b"),
        port=(PortTable(name="p", path="/dev/none"),),
        sensor=(SensorTable(id="ais1", port="p", role="ais"),),
    )
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda item: told.append(item.text))
    acquisition.chains[0].changed(None, 0)
    return acquisition


def run(acquisition: Acquisition, seconds: range, data: bytes) -> None:
    (chain,) = acquisition.chains
    for second in seconds:
        chain.chunk(data, second * NS_PER_S)
        chain.flush(second * NS_PER_S)
        acquisition.frame(second * NS_PER_S + 1000)


def test_a_radar_whose_lines_are_all_refused_is_told_and_one_that_hears_nothing_is_not() -> None:
    told: list[str] = []
    config = BoatConfig(
        boat=BoatTable(id="b"),
        port=(PortTable(name="p", path="/dev/none"), PortTable(name="q", path="/dev/none2")),
        sensor=(SensorTable(id="radar1", port="p", role="radar"), SensorTable(id="radar2", port="q", role="radar")),
    )
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda item: told.append(item.text))
    for chain in acquisition.chains:
        chain.changed(None, 0)
    for second in range(1, 20):
        acquisition.chains[0].chunk(sealed("RATTM,x,1,2,T,3,4,T,1,5,N,x,T,,,") + b"\r\n", second * NS_PER_S)
        for chain in acquisition.chains:
            chain.flush(second * NS_PER_S)
        acquisition.frame(second * NS_PER_S + 1000)
    assert [text for text in told if "radar" in text] == [
        "radar1 is silent for 10 s: 10 bad lines came, no good one: not-a-number 10"
    ]


@pytest.mark.parametrize("name", ["RTCM 3 corrections", "SkyTraq binary", "u-blox UBX"])
def test_packets_between_the_sentences_of_a_receiver_are_no_damage(name: str) -> None:
    told: list[str] = []
    port, sensor = PortTable(name="p", path="/dev/none"), SensorTable(id="gps1", port="p", role="gps")
    config = BoatConfig(boat=BoatTable(id="b"), port=(port,), sensor=(sensor,))
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda item: told.append(item.code))
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    packet = bytes.fromhex(KNOWN[name])
    burst = 2 * (packet + b"\n") + GGA + b"\r\n" + 2 * (packet + b"\n") + RMC + b"\r\n" + packet
    for second in range(1, 40):
        chain.chunk(burst, second * NS_PER_S)
        chain.flush(second * NS_PER_S)
        acquisition.frame(second * NS_PER_S + 1000)
    assert "lines-damaged" not in told
    assert acquisition.monitors["gps1"].state(40 * NS_PER_S) == ("delivering", None)
    for second in range(40, 80):  # another program takes bytes out of the sentences
        chain.chunk(burst.replace(b"S,", b"", 1).replace(b"1.1", b"", 1), second * NS_PER_S)
        chain.flush(second * NS_PER_S)
        acquisition.frame(second * NS_PER_S + 1000)
    assert "lines-damaged" in told or "sensor-silent" in told
