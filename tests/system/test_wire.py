"""What is on the wire between a real daemon and real stations, who is let in, what a start that fails leaves behind."""

import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
import zmq

from common import link_messages as session
from common.codec import decode_frame
from common.errors import LinkError
from common.keys import new_keys
from common.link_messages import Lease
from onboard.link.allow_list import READ, AllowList
from shore.link.known_boats import Boats
from shore.link.link import CONNECT_TIMEOUT_S, Link
from shore.link.transport import LinkKeys
from shore.logbook.log_reader import read_log
from tests.link.relay import Relay
from tests.system.harness import Process, command, compass_config

HANDSHAKE_BYTES = 400
"""Of ZMTP and CURVE towards a client, less than one frame: greeting 64, WELCOME 170, READY about 100, ERROR."""


class Boat:
    """Virtual boat and daemon; with keys, `station` is on its list and `stranger` is not."""

    def __init__(self, directory: Path, daemon: Process, is_open: bool) -> None:
        self.directory = directory
        self.daemon = daemon
        ready = daemon.ready()
        self.address = str(ready["bind"])
        self.target = "127.0.0.1", int(self.address.rpartition(":")[2])
        self.mode = ("--open",) if is_open else ("--keys", directory / "station")
        if not is_open:
            for name in ("station", "stranger"):
                Boats(directory / name).remember("virtual", ready["public_key"].encode())


@contextmanager
def boat(directory: Path, *, is_open: bool) -> Iterator[Boat]:
    processes: list[Process] = []
    place = ("--dir", directory / "boat", "--bind", "tcp://127.0.0.1:*")
    try:
        virtual = Process("wayfix-onboard", "virtual", "--scenario", "5.3", "--until-stdin-closes", *place)
        processes.append(virtual)
        config = virtual.ready()["config"]
        state = directory / "state"
        if not is_open:
            AllowList(state).add(Boats(directory / "station").public_key.decode(), "station", READ)
        kept = ("--state", state, "--runtime", directory / "run")
        daemon = Process("wayfix-onboard", "run", *(["--open"] if is_open else []), config, *kept)
        processes.append(daemon)
        yield Boat(directory, daemon, is_open)
    finally:
        for process in processes:
            process.end()


def readable(frame_bytes: bytes) -> list[bytes]:
    """What would give the boat's place away: names and numbers of its fixes, and the sentences themselves."""
    frame = decode_frame(frame_bytes)
    numbers = [number for fix in frame.fixes for number in (fix.lat_deg, fix.lon_deg) if number is not None]
    packed = [struct.pack(form, number) for number in numbers for form in (">d", "<d")]
    words = [f"{abs(number):.4f}".encode() for number in numbers]
    return [b"lat_deg", b"gps1", b"boot_id", *packed, *words, *(line.text.encode() for line in frame.raw)]


@pytest.mark.slow
@pytest.mark.parametrize("is_open", [False, True])
def test_no_position_can_be_read_on_the_wire_but_with_open(tmp_path: Path, *, is_open: bool) -> None:
    with boat(tmp_path, is_open=is_open) as running, Relay(running.target) as relay:
        ashore = Process("wayfix", "connect", *running.mode, relay.address, "--log", tmp_path / "log")
        try:
            ashore.wait_for(lambda _: relay.down.bytes > 60_000, 40)
        finally:
            ashore.popen.terminate()
            ashore.finish()
            ashore.end()
        wire = bytes(relay.down.capture) + bytes(relay.up.capture)
        for side in (running.daemon, ashore):
            assert any("OPEN LINK" in line for line in side.err) is is_open, side.err
    (log,) = (tmp_path / "log").glob("*.mcap")
    secrets = {word for data in read_log(log).frames() for word in readable(data)}
    found = {word for word in secrets if word in wire}
    assert len(secrets) > 30
    assert {b"lat_deg", b"gps1", b"boot_id"} <= found if is_open else not found
    assert len(found) > len(secrets) / 3 if is_open else b"lease" not in wire


def test_without_the_right_key_there_is_one_sentence_and_no_byte_of_data(tmp_path: Path) -> None:
    with boat(tmp_path, is_open=False) as running:
        Boats(tmp_path / "astray").remember("virtual", new_keys().public)
        cases = {
            "the boat does not know this station's key": ("--keys", tmp_path / "stranger"),
            "the boat wants a key and this station gave none": ("--open",),
            "the boat did not take our greeting": ("--keys", tmp_path / "astray"),
            "this station is paired with no boat": ("--keys", tmp_path / "nobody"),
        }
        for words, mode in cases.items():
            with Relay(running.target) as relay:
                done = command("wayfix", "connect", *mode, relay.address, "--no-log")
                sentences = [line for line in done.stderr.splitlines() if "OPEN LINK" not in line]
                assert (done.returncode, len(sentences)) == (2, 1), done.stderr
                assert words in sentences[0]
                print(f"\n  wire: {words}: {relay.down.bytes} bytes over {relay.accepted} connections")
                assert relay.down.bytes <= HANDSHAKE_BYTES * relay.accepted
                assert b"connected" not in relay.down.capture
        refused = [line for line in running.daemon.err if "is not on" in line or "refused" in line]
        assert len(refused) == 1, running.daemon.err  # once a minute


@pytest.mark.in_pairs
@pytest.mark.slow
def test_a_station_that_is_revoked_gets_no_frame_later_than_a_second(tmp_path: Path) -> None:
    """It goes on asking over its old connection, as ours would not, and over a new one."""
    with boat(tmp_path, is_open=False) as running:
        own = Boats(tmp_path / "station")
        keys = LinkKeys(own.public_key, own.secret_key, own.all()[0].public_key)
        with zmq.Context() as context, context.socket(zmq.DEALER) as dealer:
            dealer.setsockopt(zmq.LINGER, 0)
            dealer.curve_serverkey, dealer.curve_publickey, dealer.curve_secretkey = keys.boat, keys.public, keys.secret
            dealer.connect(running.address)
            came_s: list[float] = []
            boot_id = running.daemon.ready()["boot_id"]

            def listen(until_s: float) -> None:
                while time.monotonic() < until_s:
                    lease = Lease("f", boot_id, session.MAX_WINDOW, 0, 0)
                    with suppress(zmq.Again):  # its connection was cut, and another one is refused
                        dealer.send(session.pack("lease", **lease.as_fields()), zmq.NOBLOCK)
                    while dealer.poll(50):
                        came_s.extend([time.monotonic()] * (len(dealer.recv_multipart()) == 2))

            listen(time.monotonic() + 2.0)
            assert len(came_s) >= 5
            done = command("wayfix-onboard", "revoke", "station", "--runtime", tmp_path / "run")
            assert done.returncode == 0, done.stderr
            revoked_s = time.monotonic()
            listen(revoked_s + 3.0)
            print(f"\n  wire: last frame {max(came_s) - revoked_s:+.3f} s after the revocation")
            assert max(came_s) - revoked_s <= 1.0
        link = Link(running.address, keys=keys)
        with pytest.raises(LinkError, match="does not know this station's key"):
            link.connect()
        link.close()


EVERYBODY = """
import sys
from onboard.link.allow_list import AllowList
from onboard.main import main
AllowList.rights_of = lambda self, key: frozenset({"read"})
sys.exit(main(sys.argv[1:]))
"""


def left_in(directory: Path) -> set[str]:
    """Every file, and how many sockets and pseudo-files of ours live on."""
    return {str(path.relative_to(directory)) for path in directory.rglob("*") if not path.is_dir()}


def test_a_start_that_fails_is_one_sentence_and_leaves_nothing(tmp_path: Path) -> None:
    config = compass_config(tmp_path, one=str(tmp_path / "nothing"))
    kept = {"state/secret-key", "state/start_no", "state/spool/lock", "boat.toml"}
    first = Process("wayfix-onboard", "run", "--open", config)
    try:
        taken = first.ready()["bind"]
        arguments = ("run", config, "--state", tmp_path / "state", "--runtime", tmp_path / "run", "--bind")
        wrong: dict[str, tuple[Any, ...]] = {
            "cannot listen there (Address already in use)": (*arguments, taken),
            "cannot listen there (": (*arguments, "tcp://no.such.host.invalid:1"),
        }
        for words, line in wrong.items():
            done = command("wayfix-onboard", *line, seconds=10)
            assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done.stderr
            assert words in done.stderr
            assert left_in(tmp_path) <= kept
        fails = [sys.executable, "-c", EVERYBODY, *map(str, arguments), "tcp://127.0.0.1:*"]
        done = subprocess.run(fails, capture_output=True, text=True, timeout=10, check=False)
        assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done.stderr
        # The message, or on a busy machine the handshake before it (event 4096, ZMQ_EVENT_HANDSHAKE_SUCCEEDED).
        told = ("its message was received", "event 4096, 0")
        assert any(f"a stranger's key is not refused: {words};" in done.stderr for words in told), done.stderr
        assert left_in(tmp_path) <= kept
        second = Process("wayfix-onboard", *arguments, "tcp://127.0.0.1:*")  # what the failures left is no hindrance
        second.ready()
        second.end()
        assert first.popen.poll() is None
    finally:
        first.end()


@pytest.mark.slow
def test_two_daemons_with_one_state_and_one_runtime_directory_both_sail_and_say_so(tmp_path: Path) -> None:
    config = compass_config(tmp_path, one=str(tmp_path / "nothing"))
    arguments = ("run", config, "--state", tmp_path / "state", "--runtime", tmp_path / "run")
    first, second = Process("wayfix-onboard", *arguments), None
    try:
        boot_id = first.ready()["boot_id"]
        second = Process("wayfix-onboard", *arguments)
        second.ready()
        second.wait_for_words("another daemon stores its frames in")
        second.wait_for_words("another daemon answers there")
        second.popen.terminate()
        assert second.finish() == 0
        done = command("wayfix-onboard", "status", "--runtime", tmp_path / "run")
        assert f"boot_id: {boot_id}" in done.stdout
    finally:
        first.end()
        if second is not None:
            second.end()


@pytest.mark.slow
def test_a_station_comes_back_over_half_a_second_of_round_trip(tmp_path: Path) -> None:
    """A greeting takes several round trips, which is more than the shortest patience with a silent socket."""
    with boat(tmp_path, is_open=False) as running, Relay(running.target) as relay:
        relay.delay(250)
        ashore = Process("wayfix", "connect", *running.mode, relay.address, "--log", tmp_path / "log")
        try:
            ashore.wait_for(lambda _: relay.down.bytes > 10_000, 30)
            relay.cut()
            ashore.wait_for_words("LINK LOST", 20)
            relay.restore()
            ashore.wait_for_words("frames arrive again", 40)
        finally:
            ashore.popen.terminate()
            ashore.finish()
            ashore.end()
        assert not any("frames lost" in line for line in ashore.err)


@pytest.mark.slow
def test_with_wait_a_boat_may_answer_late(tmp_path: Path) -> None:
    with boat(tmp_path, is_open=False) as running, Relay(running.target) as relay:
        relay.blackhole()
        ashore = Process("wayfix", "connect", "--wait", "--no-log", *running.mode, relay.address)
        try:
            time.sleep(CONNECT_TIMEOUT_S + 1.0)
            assert ashore.popen.poll() is None
            relay.restore()
            ashore.wait_for_words("filters start", 30)
        finally:
            ashore.popen.terminate()
            assert ashore.finish() == 0
            ashore.end()


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGKILL])
def test_a_code_does_not_outlive_the_terminal_that_shows_it(tmp_path: Path, ending: signal.Signals) -> None:
    with boat(tmp_path, is_open=False) as running:
        pair = Process("wayfix-onboard", "pair", "--runtime", tmp_path / "run", "--port", "0")
        try:
            pair.wait_for_words("then type this code", 10)
            pair.send(ending)
            if ending == signal.SIGKILL:
                assert pair.finish() == -signal.SIGKILL
            else:
                assert pair.finish() == 1
                assert pair.err[-1].endswith("called off: the code is worth nothing")
            running.daemon.wait_for_words("pairing ended without a key: it was called off", 5)
        finally:
            pair.end()
