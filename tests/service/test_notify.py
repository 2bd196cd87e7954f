"""What the daemon tells its supervisor: over a real datagram socket, from a real process, when a part of it is dead."""

import asyncio
import logging
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import zmq

import onboard.reading.ports
from common import link_messages as session
from common.clock import BoatClock
from onboard.config import load
from onboard.daemon import Daemon, status_text
from onboard.notify import JournalHandler, Notifier, PrefixFormatter, in_journal, notifier, watchdog_ns
from tests.system.harness import BIN, Process, compass_config


class Supervisor:
    """The other end of $NOTIFY_SOCKET."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.socket.settimeout(10)
        self.heard: list[str] = []

    def until(self, start: str, longest_s: float = 20.0) -> list[str]:
        """Everything up to the first datagram that begins so, for a while: watchdog marks come for ever."""
        end = time.monotonic() + longest_s
        while not (self.heard and self.heard[-1].startswith(start)):
            assert time.monotonic() < end, self.heard
            self.heard.append(self.socket.recv(4096).decode())
        return self.heard

    def now(self) -> list[str]:
        """Everything that has come by now."""
        self.socket.setblocking(False)
        while True:
            try:
                self.heard.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                self.socket.settimeout(10)
                return self.heard


@pytest.fixture
def supervisor(tmp_path: Path) -> Iterator[Supervisor]:
    ear = Supervisor(str(tmp_path / "notify"))
    yield ear
    ear.socket.close()


def test_a_real_daemon_tells_ready_status_watchdog_and_stopping_in_order(
    tmp_path: Path, supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    daemon = Process("wayfix-onboard", "run", "--open", compass_config(tmp_path, nowhere="/dev/nowhere"))
    try:
        supervisor.until("READY=1")
        if not any(item.startswith("STATUS=") for item in supervisor.heard):  # on a busy machine it may come before
            supervisor.until("STATUS=")
        statuses = [item for item in supervisor.heard if item.startswith("STATUS=")]
        assert statuses == ["STATUS=boat b, 0 of 1 sensors deliver, 0 clients"]
        daemon.wait_for_words("nowhere cannot be opened: no such device")
        supervisor.heard.clear()
        time.sleep(1.0)
        assert supervisor.now().count("WATCHDOG=1") >= 4
        daemon.send(signal.SIGTERM)
        assert daemon.finish() == 0
        assert supervisor.now()[-1] == "STOPPING=1"
        assert supervisor.heard.count("STOPPING=1") == 1
        assert "READY=1" not in supervisor.heard
    finally:
        daemon.end()


def test_a_refused_start_is_never_ready(
    tmp_path: Path, supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    daemon = Process("wayfix-onboard", "run", "--open", tmp_path / "no.toml")
    assert daemon.finish() == 2
    assert supervisor.now() == []


def run_for(daemon: Daemon, seconds: float, then: Any = None) -> None:
    """The daemon in this process; `then` is called halfway."""

    async def run() -> None:
        running = asyncio.create_task(daemon.run("tcp://127.0.0.1:*", lambda _: None))
        await asyncio.sleep(seconds / 2)
        if then is not None:
            then()
        await asyncio.sleep(seconds / 2)
        daemon.stop("the test ends")
        await running

    asyncio.run(run())


def test_it_is_not_ready_while_a_port_is_still_being_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    may_open = threading.Event()
    told: list[str] = []

    def slow_driver(_: object) -> None:
        may_open.wait(4)
        raise OSError("no such driver")

    def release() -> None:
        assert "READY=1" not in told
        may_open.set()

    monkeypatch.setattr(onboard.reading.ports, "open_serial", slow_driver)
    daemon = Daemon(load(compass_config(tmp_path, p="/dev/p")), BoatClock(), notifier=Notifier(told.append))
    run_for(daemon, 1.0, release)
    assert told.count("READY=1") == 1


def test_a_daemon_stopped_before_its_ports_were_tried_was_never_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_open = threading.Event()
    monkeypatch.setattr(onboard.reading.ports, "open_serial", lambda _: may_open.wait(4))
    told: list[str] = []
    daemon = Daemon(load(compass_config(tmp_path, p="/dev/p")), BoatClock(), notifier=Notifier(told.append))
    run_for(daemon, 0.4)
    may_open.set()
    assert "READY=1" not in told
    assert told[-1] == "STOPPING=1"


def test_the_watchdog_is_fed_only_while_every_part_lives(tmp_path: Path) -> None:
    told: list[str] = []
    daemon = Daemon(load(compass_config(tmp_path, p="/dev/p")), BoatClock(), notifier=Notifier(told.append, 40_000_000))
    part_lives = [True]
    daemon.parts.append(lambda: part_lives[0])

    def dies() -> None:
        assert told.count("WATCHDOG=1") >= 2
        part_lives[0] = False
        told.clear()

    run_for(daemon, 1.2, dies)
    assert "WATCHDOG=1" not in told
    assert told[-1] == "STOPPING=1"


def test_a_hanging_loop_feeds_no_watchdog(tmp_path: Path) -> None:
    told: list[tuple[float, str]] = []
    send = Notifier(lambda text: told.append((time.monotonic(), text)), 40_000_000)
    daemon = Daemon(load(compass_config(tmp_path, p="/dev/p")), BoatClock(), notifier=send)
    started = time.monotonic()
    run_for(daemon, 0.8, lambda: time.sleep(1.0))
    feeds = [t for t, text in told if text == "WATCHDOG=1"]
    assert max(later - earlier for earlier, later in pairwise(feeds)) > 0.9
    assert feeds[-1] - started < 3.0


def test_the_watchdog_is_fed_four_times_an_interval_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    ear = Notifier(told.append, 400_000_000)
    for now_ns in range(0, 450_000_000, 1_000_000):
        monkeypatch.setattr("onboard.notify.boottime_ns", lambda now_ns=now_ns: now_ns)
        ear.watchdog()
    assert told == ["WATCHDOG=1"] * 5  # at 0, 0.1, 0.2, 0.3 and 0.4 s


def test_an_unchanged_status_is_told_once() -> None:
    told: list[str] = []
    ear = Notifier(told.append)
    for text in ("a", "a", "b", "b"):
        ear.status(text)
    assert told == ["STATUS=a", "STATUS=b"]


def test_without_a_supervisor_nothing_happens_and_a_deaf_one_is_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    for address in (None, "", str(tmp_path / "nobody")):
        if address is not None:
            monkeypatch.setenv("NOTIFY_SOCKET", address)
        ear = notifier(os.environ)
        ear.ready()
        ear.watchdog()
        ear.stopping()


def test_an_abstract_address_is_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    name = f"wayfix-test-{os.getpid()}"
    supervisor = Supervisor(f"\0{name}")
    monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
    notifier(os.environ).ready()
    assert supervisor.now() == ["READY=1"]
    supervisor.socket.close()


@pytest.mark.parametrize(
    ("environ", "expected"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "5000000"}, 5_000_000_000),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "7"}, 5_000_000_000),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "8"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_s_interval(environ: dict[str, str], expected: int | None) -> None:
    assert watchdog_ns(environ, 7) == expected


@pytest.mark.parametrize(
    ("clients", "expected"),
    [(0, "boat b, 3 of 4 sensors deliver, 0 clients"), (1, "boat b, 3 of 4 sensors deliver, 1 client")],
)
def test_the_status_line(clients: int, expected: str) -> None:
    assert status_text("b", 3, 4, clients) == expected


def test_the_status_counts_clients_that_come_and_go(tmp_path: Path, supervisor: Supervisor) -> None:
    environ = {**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify")}
    line: list[str | Path] = [BIN / "wayfix-onboard", "run", "--open", compass_config(tmp_path, p="/dev/nowhere")]
    with subprocess.Popen(line, env=environ, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as daemon:
        assert daemon.stdout is not None
        address = daemon.stdout.readline().split('"bind": "')[1].split('"')[0]
        with zmq.Context() as context, context.socket(zmq.DEALER) as client:
            client.connect(address)
            lease = session.Lease("a1", "0", 4096, 0, 0)
            client.send(session.pack("lease", **lease.as_fields()))
            supervisor.until("STATUS=boat b, 0 of 1 sensors deliver, 1 client")
            client.send(session.pack("bye", session="a1"))
            supervisor.until("STATUS=boat b, 0 of 1 sensors deliver, 0 clients")
        daemon.terminate()
    assert daemon.returncode == 0


def record(level: int, text: str, **fields: str) -> logging.LogRecord:
    made = logging.LogRecord("onboard.daemon", level, "daemon.py", 7, "%s", (text,), None, "tell")
    vars(made).update(fields)
    return made


def test_a_prefix_stands_before_every_line() -> None:
    formatter = PrefixFormatter("%(message)s")
    assert formatter.format(record(logging.WARNING, "gps lost")) == "<4>gps lost"
    assert formatter.format(record(logging.ERROR, "two\nlines")) == "<3>two\n<3>lines"


def test_an_event_has_its_fields_in_the_journal_and_another_line_has_none() -> None:
    sent: list[tuple[str, dict[str, Any]]] = []
    handler = JournalHandler(lambda text, **fields: sent.append((text, fields)))
    handler.handle(record(logging.WARNING, "gps lost", sensor="gps", code="port-lost"))
    handler.handle(record(logging.INFO, "words"))
    (text, event), (_, words) = sent
    assert text == "gps lost"
    assert (event["PRIORITY"], event["SENSOR"], event["CODE"]) == ("4", "gps", "port-lost")
    assert words["PRIORITY"] == "6"
    assert not {"SENSOR", "CODE"} & set(words)


def test_only_the_journal_s_own_stream_is_the_journal(tmp_path: Path) -> None:
    with (tmp_path / "stream").open("w") as stream:
        status = os.fstat(stream.fileno())
        assert in_journal({"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}, stream.fileno())
        assert not in_journal({"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino + 1}"}, stream.fileno())
        assert not in_journal({}, stream.fileno())


def test_a_redirected_stderr_has_no_prefixes(tmp_path: Path) -> None:
    line: list[str | Path] = [BIN / "wayfix-onboard", "run", "--open", tmp_path / "no.toml"]
    for stream, start in (("1:1", "wayfix-onboard: "), (None, "<3>wayfix-onboard: ")):
        with (tmp_path / "log").open("w+") as log:
            status = os.fstat(log.fileno())
            environ = {**os.environ, "JOURNAL_STREAM": stream or f"{status.st_dev}:{status.st_ino}"}
            assert subprocess.run(line, env=environ, stderr=log, check=False).returncode == 2
            log.seek(0)
            assert log.read().startswith(start)
