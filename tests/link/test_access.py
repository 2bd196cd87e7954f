import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

from common.events import event
from common.keys import fingerprint, new_keys
from common.messages import Event
from onboard.journal import Journal
from onboard.link.access import Access
from onboard.link.allow_list import COMMAND, READ, AllowList

KEY = new_keys().public.decode()


@pytest.fixture
def context() -> Iterator["zmq.Context[zmq.Socket[bytes]]"]:
    made: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    yield made
    made.term()


def test_an_open_link_lets_everybody_command_and_says_so(context: "zmq.Context[zmq.Socket[bytes]]") -> None:
    told: list[Event] = []
    access = Access(context, None, Journal(told.append, lambda: 7))
    assert (access.secret_key, access.public_key) == (None, None)
    assert access.rights(None) == access.rights(KEY) == COMMAND
    assert access.name_of("anybody") == "anybody"
    assert asyncio.run(access.start()) == []
    access.opened("tcp://127.0.0.1:5760")
    access.close()
    assert told == [event("link-open", 7, "link", bind="tcp://127.0.0.1:5760")]


def test_with_keys_the_list_decides_and_a_stranger_is_an_event(
    tmp_path: Path, context: "zmq.Context[zmq.Socket[bytes]]"
) -> None:
    told: list[Event] = []
    allow_list = AllowList(tmp_path)
    allow_list.add(KEY, "laptop", READ)
    came, stranger = asyncio.Event(), new_keys()

    def tell(happening: Event) -> None:
        told.append(happening)
        came.set()

    access = Access(context, allow_list, Journal(tell, lambda: 7))

    async def run() -> None:
        answering = await access.start()
        server, client = context.socket(zmq.ROUTER), context.socket(zmq.DEALER)
        server.setsockopt_string(zmq.ZAP_DOMAIN, "wayfix")
        server.setsockopt(zmq.CURVE_SERVER, 1)
        server.setsockopt(zmq.CURVE_SECRETKEY, access.secret_key or b"")
        server.bind("tcp://127.0.0.1:*")
        client.setsockopt(zmq.LINGER, 0)
        client.setsockopt(zmq.CURVE_SERVERKEY, (access.public_key or "").encode())
        client.setsockopt(zmq.CURVE_PUBLICKEY, stranger.public)
        client.setsockopt(zmq.CURVE_SECRETKEY, stranger.secret)
        client.connect(server.getsockopt_string(zmq.LAST_ENDPOINT))
        await came.wait()
        client.close()
        server.close()
        for task in answering:
            task.cancel()
        await asyncio.gather(*answering, return_exceptions=True)

    asyncio.run(asyncio.wait_for(run(), 10))
    access.opened("tcp://127.0.0.1:5760")
    access.close()
    assert told == [event("station-refused", 7, "link", fingerprint=fingerprint(stranger.public.decode()))]
    assert access.rights(KEY) == READ
    assert access.rights(stranger.public.decode()) is None
    assert access.name_of(KEY) == "laptop"
