"""The test tool `relay` does what its name says: each control, on a real connection."""

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from tests.link.relay import Relay


class Echo:
    """A server that sends back what it gets, and what it got."""

    def __init__(self, prefix: bytes = b"") -> None:
        self.prefix = prefix
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.address: tuple[str, int] = self.socket.getsockname()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                connection, _ = self.socket.accept()
                threading.Thread(target=self._echo, args=(connection,), daemon=True).start()

    def _echo(self, connection: socket.socket) -> None:
        with connection, suppress(OSError):
            while data := connection.recv(65_536):
                connection.sendall(self.prefix + data)


@pytest.fixture
def echo() -> Iterator[Echo]:
    server = Echo()
    yield server
    server.socket.close()


@pytest.fixture
def relay(echo: Echo) -> Iterator[Relay]:
    with Relay(echo.address) as made:
        yield made


def connected(relay: Relay, timeout_s: float = 5.0) -> socket.socket:
    return socket.create_connection((relay.host, relay.port), timeout_s)


def exactly(end: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count and (more := end.recv(count - len(data))):
        data += more
    return data


def round_trip_s(end: socket.socket, data: bytes = b"ping") -> float:
    begin_s = time.monotonic()
    end.sendall(data)
    assert exactly(end, len(data)) == data
    return time.monotonic() - begin_s


def test_bytes_pass_are_counted_and_kept(relay: Relay) -> None:
    with connected(relay) as end:
        data = bytes(range(256)) * 2_000
        sender = threading.Thread(target=end.sendall, args=(data,))
        sender.start()
        assert exactly(end, len(data)) == data
        sender.join()
        assert relay.connections == 1
        end.shutdown(socket.SHUT_WR)
        assert end.recv(1) == b""  # the end of one side reaches the other
    assert relay.up.bytes == relay.down.bytes == len(data)
    assert relay.up.capture == relay.down.capture == data


def test_a_cut_closes_and_refuses_until_restored(relay: Relay) -> None:
    with connected(relay) as end:
        round_trip_s(end)
        relay.cut()
        with suppress(ConnectionResetError):
            assert end.recv(1) == b""
    for _ in range(2):
        with pytest.raises(ConnectionRefusedError):
            connected(relay)
    port = relay.port
    relay.restore()
    with connected(relay) as end:
        round_trip_s(end)
    assert relay.port == port


def test_a_blackhole_is_silent_and_holds_what_it_got(relay: Relay) -> None:
    with connected(relay) as end:
        round_trip_s(end)
        relay.blackhole()
        end.sendall(b"held")
        end.settimeout(0.3)
        with pytest.raises(TimeoutError):
            end.recv(1)
        with pytest.raises(TimeoutError):
            connected(relay, 0.5)
        assert relay.up.bytes == relay.down.bytes == 4
        relay.restore()
        end.settimeout(5)
        assert exactly(end, 4) == b"held"
        with connected(relay) as second:
            round_trip_s(second)


def test_a_blackhole_swallows_what_is_on_its_way(relay: Relay) -> None:
    with connected(relay) as end:
        relay.delay(200)
        end.sendall(b"late")
        time.sleep(0.05)
        relay.blackhole()
        time.sleep(0.3)
        assert relay.up.bytes == 0
        relay.restore()
        assert exactly(end, 4) == b"late"


def test_in_a_blackhole_the_death_of_one_end_is_not_heard_at_the_other(relay: Relay) -> None:
    with connected(relay) as end:
        round_trip_s(end)
        relay.blackhole()
        end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    time.sleep(0.2)
    assert relay.connections == 1
    relay.restore()
    deadline_s = time.monotonic() + 5
    while relay.connections and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert relay.connections == 0


def test_a_client_that_waits_in_a_blackhole_comes_through_afterwards(relay: Relay) -> None:
    relay.blackhole()
    threading.Timer(0.4, relay.restore).start()
    with connected(relay, 10) as end:  # its SYN is sent again after 1 s
        round_trip_s(end)


def test_blackhole_after_cut_and_cut_after_blackhole(relay: Relay) -> None:
    relay.cut()
    relay.blackhole()
    with pytest.raises(TimeoutError):
        connected(relay, 0.3)
    relay.cut()
    with pytest.raises(ConnectionRefusedError):
        connected(relay)
    relay.restore()
    with connected(relay) as end:
        round_trip_s(end)


def test_delay_and_jitter(relay: Relay) -> None:
    with connected(relay) as end:
        round_trip_s(end)
        relay.delay(100, jitter_ms=20)
        trips_s = [round_trip_s(end) for _ in range(10)]
        assert min(trips_s) >= 0.16
        assert max(trips_s) - min(trips_s) > 0.01
        data = bytes(range(250)) * 100
        assert round_trip_s(end, data) < 2.0  # `exactly` would see another order
        relay.delay(0)
        assert min(round_trip_s(end) for _ in range(5)) < 0.1


def test_a_limit_makes_the_sender_wait(relay: Relay) -> None:
    relay.limit(400_000, queue_bytes=8_192)
    with connected(relay) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16_384)
        begin_s = time.monotonic()
        reader = threading.Thread(target=quietly, args=(exactly, end, 200_000))
        reader.start()
        end.sendall(bytes(200_000))
        sent_s = time.monotonic() - begin_s
        assert sent_s > 2.0  # all but what the queue and three kernel buffers hold; all of it takes 4 s
        passed = relay.up.bytes
        time.sleep(0.5)
        assert 10_000 <= relay.up.bytes - passed <= 60_000
        relay.cut()
        reader.join()


def test_the_limit_is_shared_by_all_connections(relay: Relay) -> None:
    relay.limit(400_000)
    with connected(relay) as one, connected(relay) as two:
        senders = [threading.Thread(target=quietly, args=(end.sendall, bytes(200_000))) for end in (one, two)]
        for sender in senders:
            sender.start()
        time.sleep(1.0)
        assert 20_000 < relay.up.bytes < 80_000
        relay.cut()
        for sender in senders:
            sender.join()


def quietly(call: Callable[..., object], *arguments: object) -> None:
    with suppress(OSError):
        call(*arguments)


def test_the_target_may_change_and_may_be_dead(relay: Relay, echo: Echo) -> None:
    other = Echo(prefix=b"other ")
    with connected(relay) as end:
        round_trip_s(end)
        relay.target = other.address
        round_trip_s(end)  # what is connected stays where it is
    with connected(relay) as end:
        end.sendall(b"x")
        assert exactly(end, 7) == b"other x"
    other.socket.close()
    with socket.create_server(("127.0.0.1", 0)) as free:
        relay.target = free.getsockname()
    with connected(relay) as end, suppress(ConnectionResetError):
        assert end.recv(1) == b""
    relay.target = echo.address
    with connected(relay) as end:
        round_trip_s(end)
