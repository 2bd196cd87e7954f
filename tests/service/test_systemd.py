"""The daemon as a service of a real systemd, once with systemd-python and once without.

Bounds are twice what is asked, the machine of the tests is busy; `pytest -rP` shows what was measured.
"""

import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.debian import make_wheel
from tests.service.container import Container, booted, install, overlay, wait_for, what_is_missing

pytestmark = [pytest.mark.slow, pytest.mark.in_pairs]

CRASH_S, HANG_S, STOP_S = 4.0, 16.0, 2.0
PRESENT, ABSENT = "with systemd-python", "without systemd-python"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The container's file system, the daemon installed in it."""
    missing = what_is_missing()
    if missing is not None:
        pytest.skip(missing)
    directory = tmp_path_factory.mktemp("systemd")
    wheel = make_wheel(directory)
    with overlay(directory) as merged:
        install(merged, wheel)
        yield merged


@pytest.fixture(scope="module", params=[PRESENT, ABSENT])
def board(root: Path, request: pytest.FixtureRequest) -> Iterator[Container]:
    """A board just booted: no network, no sensor."""
    bindings = Path("usr/lib/python3/dist-packages/systemd")
    if request.param == ABSENT:
        shutil.rmtree(root / bindings)
    try:
        with booted(root) as container:
            yield container
    finally:
        if request.param == ABSENT:
            shutil.copytree("/" / bindings, root / bindings)


@pytest.fixture
def variant(request: pytest.FixtureRequest) -> str:
    """Which of the two boards this is."""
    return str(request.node.callspec.params["board"])


@pytest.fixture
def service(board: Container) -> Container:
    """The board with a compass that delivers and the daemon active."""
    assert board.call("systemctl", "start", "feeder", "wayfix-onboard").returncode == 0
    return board


def text_of(entry: dict[str, Any]) -> str:
    return str(entry.get("MESSAGE"))


def figure(variant: str, what: str, seconds: float) -> None:
    print(f"{variant}: {what} {seconds:.2f} s")


def test_it_boots_without_network_and_without_any_sensor(board: Container) -> None:
    links = board.call("ls", "/sys/class/net").stdout.split()
    assert not {link for link in links if link.startswith(("eth", "en", "wl", "host"))}
    wait_for(lambda: board.show("ActiveState") == "active", "the daemon")
    assert board.show("NRestarts") == "0"
    wait_for(lambda: board.show("StatusText") == "boat springer, 0 of 2 sensors deliver, 0 clients", "its status")
    board.call("systemctl", "start", "feeder")
    wait_for(lambda: board.show("StatusText") == "boat springer, 1 of 2 sensors deliver, 0 clients", "the compass")


def test_it_is_ready_when_ports_were_tried_and_the_socket_is_bound(service: Container, variant: str) -> None:
    service.call("systemctl", "stop", "wayfix-onboard")
    started_s = time.monotonic()
    service.call("systemctl", "start", "wayfix-onboard")
    assert service.probe()["boat_id"] == "springer"
    figure(variant, "start -> ready", service.active_since_s() - started_s)
    entries = [text_of(entry) for entry in service.journal("-n", "40")]
    started = last(entries, r"Started wayfix-onboard\.service")
    assert last(entries, r"gps cannot be opened: no such device") < started
    assert last(entries, r"compass open at /run/feeder/compass") < started
    assert last(entries, r'\{"ready"') < started


def last(entries: list[str], pattern: str) -> int:
    """Index of the newest entry that contains the pattern."""
    return max(number for number, text in enumerate(entries) if re.search(pattern, text))


@pytest.mark.parametrize("name", ["KILL", "SEGV"])
def test_after_a_crash_it_is_active_again(service: Container, variant: str, name: str) -> None:
    before = service.probe()
    restarts = int(service.show("NRestarts"))
    seconds = service.back_after_s(service.signal(name), restarts)
    figure(variant, f"SIG{name} -> active", seconds)
    assert seconds <= CRASH_S
    after = service.probe()
    assert after["clock_id"] == before["clock_id"]
    assert after["boot_id"] != before["boot_id"]
    assert after["start_no"] == before["start_no"] + 1
    gap_s = told_gap_s(service, before["boot_id"], variant)
    assert 0.8 < gap_s < seconds + 0.5
    if name == "SEGV":
        service.wait_for_entry(lambda entry: "Fatal Python error: Segmentation fault" in text_of(entry), "its stack")


def test_after_a_hang_the_watchdog_ends_it_and_the_gap_is_an_event(service: Container, variant: str) -> None:
    before = service.probe()
    time.sleep(1.0)
    restarts = int(service.show("NRestarts"))
    seconds = service.back_after_s(service.signal("USR1"), restarts)
    figure(variant, "hang -> active", seconds)
    assert seconds <= HANG_S
    assert told_gap_s(service, before["boot_id"], variant) == pytest.approx(seconds, abs=1.0)
    service.wait_for_entry(lambda entry: "Watchdog timeout" in text_of(entry), "the watchdog's line")
    service.wait_for_entry(lambda entry: "sitecustomize.py" in text_of(entry), "the stack of the hanging loop")


def told_gap_s(service: Container, former: str, variant: str) -> float:
    """The gap as the restarted daemon told it in its log."""
    right = "the former run ended without a goodbye"
    newest = service.active_since_s() - 5.0

    def fits(entry: dict[str, Any]) -> bool:
        return right in text_of(entry) and int(entry["__MONOTONIC_TIMESTAMP"]) / 1e6 > newest

    entry = service.wait_for_entry(fits, "the event of the gap")
    assert entry["PRIORITY"] == "4"
    if variant == PRESENT:
        assert (entry["SENSOR"], entry["CODE"]) == ("daemon", "daemon-resumed")
    found = re.search(r"([\d.]+) s without frames", text_of(entry))
    assert found, former
    return float(found[1])


def test_it_stops_at_once_and_starts_without_a_word_about_a_gap(service: Container, variant: str) -> None:
    started_s = time.monotonic()
    assert service.call("systemctl", "stop", "wayfix-onboard").returncode == 0
    seconds = time.monotonic() - started_s
    figure(variant, "stop", seconds)
    assert seconds <= STOP_S
    assert service.show("Result") == "success"
    assert service.show("ExecMainStatus") == "0"
    service.call("systemctl", "start", "wayfix-onboard")
    entries = [text_of(entry) for entry in service.journal()]
    assert not any("without a goodbye" in text for text in entries[last(entries, "daemon stops: SIGTERM") :])


def test_the_journal_has_priority_sensor_and_code(service: Container, variant: str) -> None:
    service.call("systemctl", "restart", "feeder")
    silent = service.wait_for_entry(lambda entry: text_of(entry).startswith("compass lost: "), "the pulled compass")
    delivers = service.wait_for_entry(lambda entry: text_of(entry) == "compass1 delivers", "the plugged compass")
    assert (silent["PRIORITY"], delivers["PRIORITY"]) == ("4", "6")
    assert {silent["SYSLOG_IDENTIFIER"], delivers["SYSLOG_IDENTIFIER"]} == {"wayfix-onboard"}
    assert silent["_TRANSPORT"] == ("journal" if variant == PRESENT else "stdout")
    if variant == PRESENT:
        assert (silent["SENSOR"], silent["CODE"]) == ("compass", "port-lost")
        assert (delivers["SENSOR"], delivers["CODE"]) == ("compass1", "sensor-delivering")
        assert {text_of(entry) for entry in service.journal("SENSOR=compass1")} == {"compass1 delivers"}


def test_a_refusal_is_an_error_in_the_journal(service: Container) -> None:
    file = "/etc/wayfix/boat.toml"
    service.call("mv", file, f"{file}.away")
    try:
        service.call("systemctl", "restart", "--no-block", "wayfix-onboard")
        refusal = service.wait_for_entry(lambda entry: text_of(entry).startswith("wayfix-onboard: "), "the refusal")
        assert refusal["PRIORITY"] == "3"
        assert file in text_of(refusal)
    finally:
        service.call("mv", f"{file}.away", file)
    wait_for(lambda: service.show("ActiveState") == "active", "the daemon once its file is back")


def test_it_runs_hardened(service: Container) -> None:
    status = service.call("cat", f"/proc/{service.show('MainPID')}/status").stdout
    facts = dict(line.split(":\t", 1) for line in status.splitlines())
    assert int(facts["CapEff"], 16) == int(facts["CapBnd"], 16) == 0
    assert facts["NoNewPrivs"] == "1"
    assert facts["Seccomp"] == "2"
    assert int(facts["Uid"].split()[0]) >= 61184  # DynamicUser's range
    print(f"resident {facts['VmRSS'].strip()}, {facts['Threads']} threads")
    state = service.call("cat", "/var/lib/wayfix/start_no").stdout
    assert int(state) >= 1
    stat = ("stat", "-c", "%a %U", "/run/wayfix/alive")
    wait_for(lambda: service.call(*stat).stdout.strip() == "600 wayfix-onboard", "the mark of the first frame")


def test_systemd_has_no_remark_on_the_unit(service: Container) -> None:
    unit = "/etc/systemd/system/wayfix-onboard.service"
    done = service.call("systemd-analyze", "verify", "--man=no", unit)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert service.call("systemctl", "enable", "wayfix-onboard").returncode == 0
    assert service.call("systemctl", "is-enabled", "wayfix-onboard").stdout.strip() == "enabled"
