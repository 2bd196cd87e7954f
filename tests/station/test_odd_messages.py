"""Messages of any shape from a board (fuzzing): each is counted, or refused in a sentence; there is no traceback."""

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st

from common import link_messages as session
from common.errors import WayfixError
from common.versions import LINK_VERSION, SCHEMA_VERSION
from shore.link.link import Link
from shore.live.run import LiveRun, Options
from shore.logbook.log_reader import read_log
from tests.navigate.voyages import BOAT
from tests.station.logs import without_none
from tests.station.transports import FakeTransport

ANY = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.sampled_from([-1, 0, 1, 2**31, 2**53, 2**63, 2**64 - 1])
    | st.floats()
    | st.text(max_size=4)
    | st.binary(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
FIELDS = (
    "boat_id", "boot_id", "clock_id", "start_no", "next_seq", "runs", "unlisted", "clock_rate", "config", "versions",
    "sensors", "schema", "link", "echo_ns", "rx_ns", "tx_ns", "gone", "seq", "k", "sent", "reason", "what", "cure",
    "id", "text", "more",
)  # fmt: skip
RUN = st.lists(st.sampled_from(["1", "2", "b"]) | st.integers(0, 9) | ANY, min_size=3, max_size=4)
SHAPES = st.dictionaries(st.sampled_from(FIELDS), ANY, max_size=4) | st.fixed_dictionaries(
    {},
    optional={
        "runs": st.lists(RUN, max_size=3),
        "gone": st.lists(RUN, max_size=3),
        "sensors": st.lists(ANY, max_size=2),
    },
)
SOUND: dict[str, Any] = {
    "schema": SCHEMA_VERSION, "link": LINK_VERSION, "boat_id": "springer", "boot_id": "b", "clock_id": "c",
    "start_no": 1, "next_seq": 0, "runs": [["b", 1, 0, 0]], "config": without_none(asdict(BOAT)), "sensors": [],
}  # fmt: skip
MESSAGES = st.lists(st.tuples(st.sampled_from(session.TYPES), SHAPES, st.booleans()), max_size=4)


def refused_or_done(
    greeting: dict[str, Any], messages: list[tuple[str, dict[str, Any], bool]], directory: Path | None
) -> None:
    """Whatever else is raised fails the test."""
    with suppress(WayfixError):
        run_over(greeting, messages, directory)


def run_over(
    greeting: dict[str, Any], messages: list[tuple[str, dict[str, Any], bool]], directory: Path | None
) -> None:
    """A session with a board that sends these; raises WayfixError as the command does, which says it."""
    transport = FakeTransport()
    link = Link("10.0.0.1", transport=transport, now_ns=transport.now_ns)
    transport.answer = lambda message: (
        [[session.pack("connected", **greeting)]] if message.get("boot_id") == "0" else []
    )
    turns = iter(range(len(messages) + 2))

    def stopped() -> bool:
        if (turn := next(turns, None)) is None:
            return True
        if 0 < turn <= len(messages):
            kind, fields, is_sound = messages[turn - 1]
            head = session.pack(kind, **({**SOUND, **fields} if is_sound else fields))
            transport.inbox.append([head, *([b"\x80"] if kind == "frame" else [])])
        return False

    LiveRun(link, Options(log_dir=directory, connect_s=0.1), stopped, lambda _line: None).run()


@given(SHAPES, MESSAGES)
@example({}, [("alive", {"gone": 5}, False)])
@example({"versions": {"wayfix": b"\xff"}, "more": [float("nan"), 2**64 - 1]}, [("end", {"sent": "x"}, True)])
@example({"sensors": [{"id": 5, "state": b"", "reason": [1]}]}, [("connected", {"runs": 5}, True)])
@settings(max_examples=50)
def test_any_message_is_one_sentence(fields: dict[str, Any], messages: list[tuple[str, dict[str, Any], bool]]) -> None:
    refused_or_done({**SOUND, **fields}, messages, None)


@given(SHAPES, MESSAGES)
@example({"versions": {"wayfix": b"\xff"}, "more": [float("nan"), 2**64 - 1]}, [])
@settings(max_examples=8)
def test_the_log_of_any_greeting_can_be_read(
    fields: dict[str, Any], messages: list[tuple[str, dict[str, Any], bool]]
) -> None:
    with TemporaryDirectory() as place:
        directory = Path(place)
        refused_or_done({**SOUND, **fields}, messages, directory)
        for log in directory.glob("*.mcap"):
            read_log(log).start()
            run_over(SOUND, [], directory)
