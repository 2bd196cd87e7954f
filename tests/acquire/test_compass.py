"""HDG, HDM and HDT of the compasses in the project, with their oddities."""

import pytest

from onboard.devices import Rejected, make_driver
from tests.acquire.sentences import MS, compass, heading, line, sealed


@pytest.mark.parametrize(
    ("data", "mag", "true", "deviation", "variation"),
    [
        (b"$HCHDG,85.8,0.0,E,0.0,E*77", 85.8, None, 0.0, 0.0),
        (b"$HCHDG,271.1,10.7,E,12.2,W*52", 271.1, None, 10.7, -12.2),
        (b"$HCHDG,123.4,,,,*46", 123.4, None, None, None),
        (b"$SDHDG,181.7,,,0.6,E*3C", 181.7, None, None, 0.6),
        (b"$HCHDT,86.2,T*15", None, 86.2, None, None),
        (sealed("HEHDT,123.4"), None, 123.4, None, None),
        (b"$HCHDM,123.4,M*2D", 123.4, None, None, None),
        (sealed("HCHDM,123.4,M,"), 123.4, None, None, None),
        (sealed("HCHDM,360.0,M"), 0.0, None, None, None),
        (sealed("HCHDT,0.0,T"), None, 0.0, None, None),
    ],
)
def test_headings(
    data: bytes, mag: float | None, true: float | None, deviation: float | None, variation: float | None
) -> None:
    driver = make_driver(compass())
    assert driver.claims(line(data))
    found = heading(driver.feed(line(data)))
    assert (found.heading_mag_deg, found.heading_true_deg) == (mag, true)
    assert (found.deviation_deg, found.variation_deg) == (deviation, variation)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("HCHDG,,0.0,E,0.0,E", "empty"),
        ("HCHDT,,T", "empty"),
        ("HCHDM,,M", "empty"),
        ("HCHDM,123.4,T", "unit"),
        ("HCHDT,123.4,M", "unit"),
        ("HCHDM,123.4,M,5", "fields"),
        ("HCHDM,123.4,M,,", "fields"),
        ("HCHDT,123.4,T,", "fields"),
        ("HCHDT,abc,T", "not-a-number"),
        ("HCHDT,360.1,T", "range"),
    ],
)
def test_refusals_count_for_the_compass(body: str, reason: str) -> None:
    assert make_driver(compass()).feed(line(sealed(body))) == Rejected(reason, "compass1")


def test_latency_is_subtracted_and_whole_microseconds_remain() -> None:
    driver = make_driver(compass(latency_ms=12.3456))
    assert heading(driver.feed(line(b"$HCHDT,86.2,T*15", 100 * MS))).t_ns == 87_654_000
    assert driver.flush(10**18) == ()


def test_talker_filter() -> None:
    driver = make_driver(compass(talkers=("HC",)))
    assert driver.claims(line(b"$HCHDT,86.2,T*15"))
    assert not driver.claims(line(sealed("IIHDT,86.2,T")))
    assert not driver.claims(line(sealed("HCXDR,A,1.0,D,PITCH")))
