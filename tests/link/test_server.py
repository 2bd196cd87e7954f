"""The board's server over a real socket, driven without a daemon around it."""

import asyncio
from itertools import pairwise
from typing import Any

import pytest
import zmq
import zmq.asyncio

from common import link_messages as session
from common.errors import WayfixError
from common.link_messages import BoundedRun, FrameRange, Lease
from common.units import NS_PER_S
from common.versions import LINK_VERSION, SCHEMA_VERSION
from onboard.link.router import Router
from onboard.link.server import Limits
from tests.link.bench import BOOT, PERIOD_NS, Bench, Client, on_bench


def test_hello_is_answered_with_what_the_board_holds() -> None:
    async def run(bench: Bench) -> None:
        bench.publish(2)
        client = bench.client()
        await client.say("hello", schema=SCHEMA_VERSION, link=LINK_VERSION)
        connected = await client.expect("connected")
        assert connected["next_seq"] == 3
        assert connected["runs"] == [[BOOT, 1, 0, 3]]
        assert bench.server.clients == 0

    on_bench(run)


@pytest.mark.parametrize(
    ("greeting", "what"),
    [
        (
            {"schema": SCHEMA_VERSION + 1, "link": LINK_VERSION},
            "schema 2 there, 1 here: the other side is newer, install the same version on both",
        ),
        ({"schema": SCHEMA_VERSION}, "link 1 there, 2 here: this side is newer, install the same version on both"),
        ({"schema": "1", "link": LINK_VERSION}, "the other side names no schema version"),
        ({"link": LINK_VERSION}, "the other side names no schema version"),
    ],
)
def test_a_client_of_another_version_is_told_so(greeting: dict[str, Any], what: str) -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("hello", **greeting)
        assert (await client.expect("error"))["what"] == what
        if "schema" in greeting:
            await client.say("lease", **greeting, **Lease("e", "0", session.WINDOW_BYTES, 0, 5).as_fields())
            assert (await client.expect("error"))["what"] == what
            assert bench.server.clients == 0

    on_bench(run)


def test_a_lease_in_place_of_hello_leaves_no_frame_between() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.lease(boot_id="0")
        connected = await client.expect("connected")
        await client.expect("alive")
        bench.publish(1)
        assert [item.seq for item in await client.frames(1)] == [connected["next_seq"]]

    on_bench(run)


def test_a_lease_is_answered_and_new_frames_come_at_once() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.lease()
        alive = await client.expect("alive")
        assert alive["echo_ns"] == 5
        assert alive["rx_ns"] <= alive["tx_ns"]
        assert (alive["next_seq"], alive["gone"]) == (1, [])
        bench.publish(3)
        assert [item.seq for item in await client.frames(3)] == [1, 2, 3]
        assert bench.events[0].text == "client test 0 joined"

    on_bench(run)


def test_missing_frames_come_oldest_first_and_lost_ones_are_told() -> None:
    async def run(bench: Bench) -> None:
        bench.publish(9)
        client = await bench.joined()
        await client.lease(FrameRange(BOOT, 2, 4), FrameRange(BOOT, 7, 8), FrameRange("cd" * 8, 3, 9))
        alive = await client.expect("alive")
        assert alive["gone"] == [["cd" * 8, 3, 9]]
        assert [item.seq for item in await client.frames(5)] == [2, 3, 4, 7, 8]
        await client.lease(FrameRange(BOOT, 2, 4))  # they came, but could not be stored: again
        assert [item.seq for item in await client.frames(3)] == [2, 3, 4]

    on_bench(run)


def test_no_more_than_a_window_is_on_the_way_and_the_newest_goes_next() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        client.window = 4096
        await client.lease()
        await client.expect("alive")
        bench.publish(20, texts=3)
        await asyncio.sleep(0.05)
        first = await client.frames(2)
        assert [item.seq for item in first] == [1, 2]
        while not await client.is_quiet():
            await client.hear()
        assert client.received <= 4096
        await client.lease()
        assert [item.seq for item in await client.frames(1)] == [20]

    on_bench(run)


def test_the_last_frame_with_a_fix_is_not_passed_over() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        client.window = 4096
        await client.lease()
        await client.expect("alive")
        bench.publish(20, texts=3, fixes=(1, 7, 12))
        assert [item.seq for item in await client.frames(2)] == [1, 2]
        await client.lease()
        assert [item.seq for item in await client.frames(2)] == [12, 20]
        await client.lease()
        await client.expect("alive")
        bench.publish(1)
        assert [item.seq for item in await client.frames(1)] == [21]

    on_bench(run)


def test_a_client_that_comes_back_over_another_connection_is_the_same_one() -> None:
    async def run(bench: Bench) -> None:
        first = await bench.joined()
        bench.publish(3)  # on the way when the connection breaks
        second = Client(bench.context, bench.endpoint, first.name)
        bench.clients.append(second)
        await second.lease(FrameRange(BOOT, 1, 3))
        assert [item.seq for item in await second.frames(3)] == [1, 2, 3]
        bench.publish(1)
        assert [item.seq for item in await second.frames(1)] == [4]
        assert bench.server.clients == 1
        assert [item.code for item in bench.events] == ["client-joined"]

    on_bench(run)


def test_another_start_of_the_daemon_greets_anew() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.lease(boot_id="cd" * 8)
        await client.expect("connected")
        await client.expect("alive")

    on_bench(run)


@pytest.mark.parametrize("period_s", [None, 1.0])
def test_run_m_gives_exactly_m_frames_then_end(period_s: float | None) -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.lease(run=BoundedRun(4, 0, BOOT, 1, period_s))
        bench.publish(60)
        frames = await client.frames(4)
        length_ns = NS_PER_S if period_s else PERIOD_NS
        assert [item.t1_ns - item.t0_ns for item in frames] == [length_ns] * 4
        assert all(item.t0_ns % length_ns == 0 for item in frames)
        assert all(after.t0_ns == before.t1_ns for before, after in pairwise(frames))
        end = await client.expect("end")
        assert (end["sent"], end["reason"]) == (4, "all frames sent")
        await client.say("bye", session=client.name)

    on_bench(run)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"session": "x y"}, "session must be"),
        ({"window": 10}, "window must be"),
        ({"window": True}, "window must be"),
        ({"received": -1}, "received must be"),
        ({"missing": [["ab", 5, 4]]}, "last must be"),
        ({"missing": [["ab", 5]]}, "a range must be"),
        ({"missing": [["ab", 0, 1]] * 65}, "missing must be"),
        ({"run": {"m": 0, "k": 0, "boot_id": "ab", "seq": 0}}, "m must be"),
        ({"run": {"m": 2, "k": 0, "boot_id": "ab", "seq": 0, "period_s": 0.01}}, "period_s must be from"),
        ({"run": {"m": 2, "k": 0, "boot_id": "ab", "seq": 0, "period_s": float("nan")}}, "period_s must be from"),
        ({"run": {"m": 2, "k": 0, "boot_id": "ab", "seq": 0, "period_s": 0.25}}, "period_s must be a multiple"),
        ({"run": {"m": 2, "k": 0, "boot_id": "ab", "seq": 0, "period_s": "1"}}, "period_s must be a number"),
    ],
)
def test_a_lease_that_cannot_be_granted_is_answered_and_the_client_may_mend_it(
    change: dict[str, Any], part: str
) -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("lease", **{**Lease("a", BOOT, 4096, 0, 0).as_fields(), **change})
        assert (await client.expect("error"))["what"].startswith(part)
        await client.lease()
        await client.expect("alive")

    on_bench(run)


def test_one_client_too_many_is_refused_until_another_leaves() -> None:
    async def run(bench: Bench) -> None:
        first = await bench.joined()
        second = bench.client()
        await second.lease()
        assert (await second.expect("error"))["what"] == "1 client is connected"
        await first.say("bye", session=first.name)
        for _ in range(50):
            await second.lease()
            if (await second.hear())[0]["type"] == "alive":
                break
        assert bench.server.clients == 1

    on_bench(run, Limits(clients=1))


def test_a_silent_client_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    async def run(bench: Bench) -> None:
        await bench.joined()
        bench.publish(1)
        assert bench.server.clients == 1
        later_ns = 10**18
        monkeypatch.setattr("onboard.link.server.boottime_ns", lambda: later_ns)
        bench.publish(1)
        assert bench.server.clients == 0
        assert bench.events[-1].text == "client test 0 left: it was not heard of any more"

    on_bench(run)


def test_garbage_is_counted_and_harms_nobody() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        for parts in ([b""], [b"\xc1"], [b"x" * 9000], [session.pack("lease")], [session.pack("hello"), b"more"]):
            await client.socket.send_multipart(parts)
            await client.expect("error")
        await client.socket.send(session.pack("frame", boot_id=BOOT, seq=1))
        await client.lease()
        await client.expect("alive")
        assert bench.server.malformed == 6

    on_bench(run)


def test_a_command_needs_its_right_and_is_answered() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("command", id=7, name="mark", argument="buoy")
        assert await client.expect("done") == {"type": "done", "id": 7, "text": "marked"}
        await client.say("command", id=8, name="sink")
        assert (await client.expect("error"))["id"] == 8
        bench.rights = frozenset({"read"})
        await client.say("command", id=9, name="mark", argument="buoy")
        assert "may read, not command" in (await client.expect("error"))["what"]
        await client.say("command", id=10, name="status")  # reading needs no more than the right to read
        assert "no command status" in (await client.expect("error"))["what"]
        assert bench.asked == [("mark", "buoy"), ("sink", ""), ("status", "")]
        assert bench.events[-1].code == "command-refused"

    on_bench(run)


def test_a_key_that_was_removed_gets_no_frame_more() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        bench.rights = None
        bench.server.reload()
        assert "not on the board's list" in (await client.expect("error"))["what"]
        bench.publish(5)
        await client.lease()
        assert "not on the board's list" in (await client.expect("error"))["what"]
        assert await client.is_quiet()
        assert bench.server.clients == 0

    on_bench(run)


def test_a_client_whose_connection_is_gone_is_kept_for_its_lease() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        client.socket.close(linger=0)
        for _ in range(20):
            bench.publish(1)
            await asyncio.sleep(0.01)
        assert bench.server.clients == 1

    on_bench(run)


def test_a_board_that_stops_waits_for_goodbye_and_forgets_nobody_who_comes_meanwhile() -> None:
    async def run(bench: Bench) -> None:
        first, second = await bench.joined(), await bench.joined()
        stopping = asyncio.create_task(bench.server.end_all("the daemon stops", 5))
        assert (await first.expect("end"))["reason"] == "the daemon stops"
        await first.say("bye", session=first.name)
        again = Client(bench.context, bench.endpoint, second.name)  # its connection broke: `end` is lost
        bench.clients.append(again)
        await again.lease()
        await again.expect("alive")
        await again.expect("end")
        assert not stopping.done()
        stranger = bench.client()
        await stranger.lease()
        await again.say("bye", session=again.name)
        await asyncio.wait_for(stopping, 2)
        assert await stranger.is_quiet()

    on_bench(run)


def test_a_client_that_says_no_goodbye_holds_up_no_board_longer_than_allowed() -> None:
    async def run(bench: Bench) -> None:
        await bench.joined()
        await asyncio.wait_for(bench.server.end_all("the daemon stops", 0.3), 2)

    on_bench(run)


def test_all_clients_together_are_filled_at_the_rate_that_is_allowed() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        client.window = session.MAX_WINDOW
        bench.publish(200, texts=4)
        size = sum(len(data) for _, data in bench.spool.read(BOOT, 0, 200, 10**7).frames)
        loop = asyncio.get_running_loop()
        begun = loop.time()
        await client.lease(FrameRange(BOOT, 0, 200))
        seen: set[int] = set()
        while len(seen) < 201:
            seen.update(item.seq for item in await client.frames(1))
        assert size / (loop.time() - begun) < 2.5 * 200_000  # a quarter of a second's worth is saved up

    on_bench(run, Limits(fill_bytes_per_s=200_000))


def test_a_socket_in_use_is_one_sentence() -> None:
    async def run(bench: Bench) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        with pytest.raises(WayfixError, match="cannot listen there"):
            Router(context, None).bind(bench.endpoint)
        context.term()

    on_bench(run)
