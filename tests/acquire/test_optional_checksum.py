"""`checksum = "optional"`: sentences without checksum are taken, counted apart, and guarded as far as can be."""

import pytest

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.framer import Identity
from common.messages import Heading
from onboard.devices import Accepted, Line, Rejected, make_driver
from onboard.devices.optional_checksum import UNCHECKED
from onboard.reading.acquisition import Acquisition
from tests.acquire.sentences import MS, S, compass, fixes, gps, heading, line, measured, sealed
from tests.cases import CASES, needs_cases


@needs_cases
def test_gps_without_checksum() -> None:
    driver = make_driver(gps(checksum="optional"))
    found, kinds = [], []
    for k, data in enumerate((CASES / "board" / "gps-without-checksum.nmea").read_bytes().splitlines()):
        outcome = driver.feed(line(data, k * 250 * MS))
        if isinstance(outcome, Accepted):
            found += fixes(outcome.measurements)
            kinds.append(outcome.kind)
            assert outcome.unchecked
    found += fixes(driver.flush(10**18, 0))
    assert [fix.tod_ms for fix in found] == [43_200_000 + 1000 * k for k in range(5)]
    assert {*kinds} == {f"{name} {UNCHECKED}" for name in ("GGA", "ZDA", "RMC")}


@needs_cases
def test_compass_without_checksum() -> None:
    driver = make_driver(compass(checksum="optional"))
    lines = (CASES / "board" / "compass-without-checksum.nmea").read_bytes().splitlines()
    assert [heading(driver.feed(line(data))).heading_mag_deg for data in lines] == [101.4] * 10


@pytest.mark.parametrize(
    ("table", "data"),
    [
        (SensorTable(id="ais1", port="p", role="ais"), b"!AIVDM,1,1,,B,,0"),
        (SensorTable(id="radar1", port="p", role="radar"), b"$RATTM,01,0.5,45.3,T,4.2,270.1,T,,,N,,T,,120000,A"),
        (compass(model="hsc100"), b"$HCHDG,123.4,,,,"),
        (compass(model="kvh-c100"), b"$HCHDT,123.4,T"),
        (compass(model="tcm2"), b"$HCHDM,123.4,M"),
        (compass(model="tcm2"), b"$C309.8P4.0R-2.9"),
        (compass(model="hmr3000"), b"$PTNTHPR,354.9,N,5.2,N,0.2,N"),
        (SensorTable(id="gyro1", port="p", role="gyro", model="tinkerkit"), b"$PWFXG,1000,A,12345,440"),
    ],
)
def test_every_nmea_sensor_has_the_option_and_refuses_without_it(table: SensorTable, data: bytes) -> None:
    optional = SensorTable(id=table.id, port="p", role=table.role, model=table.model, checksum="optional")
    assert make_driver(table).feed(line(data)) == Rejected("no-checksum", table.id)
    outcome = make_driver(optional).feed(line(data))
    assert isinstance(outcome, Accepted)
    assert outcome.unchecked
    assert outcome.kind.endswith(UNCHECKED)


def test_a_wrong_checksum_stays_wrong_and_one_that_was_there_is_needed_from_then_on() -> None:
    driver = make_driver(compass(checksum="optional"))
    assert measured(driver.feed(line(b"$HCHDG,123.4,,,,")))
    assert driver.feed(line(sealed("HCHDG,123.4,,,,")[:-1] + b"0")) == Rejected("checksum", "compass1")
    checked = driver.feed(line(sealed("HCHDG,123.5,,,,")))
    assert isinstance(checked, Accepted)
    assert (checked.kind, checked.unchecked) == ("HDG", False)
    assert driver.feed(line(b"$HCHDG,123.4,,,,")) == Rejected("no-checksum", "compass1")


def test_a_cut_sentence_is_refused() -> None:
    driver = make_driver(compass(checksum="optional"))
    assert measured(driver.feed(line(b"$HCHDM,101.4,M")))
    assert driver.feed(line(b"$HCHDM,10")) == Rejected("fields", "compass1")


def test_a_tag_block_or_noise_before_it_is_left_where_it_was() -> None:
    driver = make_driver(compass(checksum="optional"))
    block = b"\\s:GP0001,c:1326055296*3C\\"
    for before in (block, b"\x00\xff"):
        (found,) = measured(driver.feed(line(before + b"$HCHDM,101.4,M \0")))
        assert isinstance(found, Heading)


def test_health_counts_them_apart_and_a_silent_sensor_names_the_option() -> None:
    port = PortTable(name="p", path="/dev/p")
    sensors = compass(checksum="optional", talkers=("HC",)), compass(id="compass2", talkers=("HE",))
    boat = BoatConfig(boat=BoatTable(id="b"), port=(port,), sensor=sensors)
    identity = Identity(boat_id="b", boot_id="0" * 16, clock_id="c", start_no=1)
    acquisition = Acquisition(boat, identity, 0, 0, lambda told: None)
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    for k in range(50):
        chain.chunk(b"$HCHDM,101.4,M\r\n$HEHDM,101.4,M\r\n", k * 100 * MS)
    health = {report.sensor: report for report in acquisition.frame(5 * S).health}
    assert (health["compass1"].accepted, health["compass1"].unchecked) == (50, 50)
    assert health["compass2"].rejected == {"no-checksum": 50}
    assert 'checksum = "optional"' in (health["compass2"].reason or "")
    assert chain.tally.accepted == {("compass1", f"HDM {UNCHECKED}"): 50}


def test_lines_of_other_forms_pass_through() -> None:
    driver = make_driver(compass(model="kvh-c100", checksum="optional"))
    assert driver.claims(Line(0, b"%123.4"))
    outcome = driver.feed(line(b"%123.4"))
    assert isinstance(outcome, Accepted)
    assert not outcome.unchecked
