"""The line of our own gyro sketch: signs, states, refusals."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import SensorTable
from common.messages import TurnRate
from onboard.devices import Accepted, Ignored, PortDecoder, Rejected, make_driver
from tests.acquire.sentences import GGA, MS, line, measured, sealed


def gyro(latency_ms: float = 0.0) -> SensorTable:
    return SensorTable(id="gyro1", port="p", role="gyro", model="tinkerkit", latency_ms=latency_ms)


def test_a_turn_to_starboard_is_positive_and_in_degrees() -> None:
    (rate,) = measured(make_driver(gyro(latency_ms=25)).feed(line(sealed("PWFXG,1000,A,12345,440"), 100 * MS)))
    assert rate == TurnRate(sensor="gyro1", t_ns=75 * MS, rate_deg_s=12.345)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("PWFXG,1000,S,400000,440", "saturated"),
        ("PWFXG,1000,S,7500000,440", "saturated"),
        ("PWFXG,1000,S,,440", "fields"),
        ("PWFXG,1000,A,,440", "fields"),
        ("PWFXG,1000,Z,0,440", "fields"),
        ("PWFXG,1000,,0,440", "fields"),
        ("PWFXG,,A,0,440", "fields"),
        ("PWFXG,1000,A,0,", "fields"),
        ("PWFXG,1000,A,0", "fields"),
        ("PWFXG,1000,A,0,440,1", "fields"),
        ("PWFXG", "fields"),
        ("PWFXG,1000,V,0,440", "status"),
        ("PWFXG,1000,A,1.5,440", "not-a-number"),
        ("PWFXG,1000,A,+1,440", "not-a-number"),
        ("PWFXG,1e3,A,1,440", "not-a-number"),
        ("PWFXG,4294967296,A,1,440", "range"),
        ("PWFXG,-1,A,1,440", "range"),
        ("PWFXG,1000,A,2000001,440", "range"),
        ("PWFXG,1000,A,-2000001,440", "range"),
        ("PWFXG,1000,A,1,0", "range"),
        ("PWFXG,1000,A,1,65536", "range"),
    ],
)
def test_refusals(body: str, reason: str) -> None:
    driver = make_driver(gyro())
    assert driver.claims(line(sealed(body)))
    assert driver.feed(line(sealed(body))) == Rejected(reason, "gyro1")


def test_zeroing_is_accepted_without_a_measurement() -> None:
    assert make_driver(gyro()).feed(line(sealed("PWFXG,50,Z,,440"))) == Accepted("gyro1", "PWFXG")


def test_on_a_shared_port_only_its_own_sentence_is_claimed() -> None:
    port = PortDecoder([make_driver(gyro())])
    assert port.feed(line(sealed("PWFXH,1000,A,1,440"))) == Ignored("PWFXH")
    assert port.feed(line(GGA)) == Ignored("GGA")
    assert port.feed(line(sealed("PWFXG,1000,A,1,440")[:-1] + b"x")) == Rejected("no-checksum", "gyro1")
    assert port.feed(line(sealed("PWFXG,1000,A,1,440").replace(b"1000", b"1001"))) == Rejected("checksum", "gyro1")


@given(st.integers(0, 2**32 - 1), st.integers(-2_000_000, 2_000_000), st.integers(1, 65_535))
def test_round_trip(millis: int, rate: int, samples: int) -> None:
    (found,) = measured(make_driver(gyro()).feed(line(sealed(f"PWFXG,{millis},A,{rate},{samples}"))))
    assert found == TurnRate(sensor="gyro1", t_ns=0, rate_deg_s=rate / 1000)


@given(st.binary(max_size=100) | st.text("0123456789,-AZS*.", max_size=40).map(lambda t: sealed(f"PWFXG,{t}")))
def test_arbitrary_bytes_never_raise(data: bytes) -> None:
    assert isinstance(make_driver(gyro()).feed(line(data)), Accepted | Rejected | Ignored)
