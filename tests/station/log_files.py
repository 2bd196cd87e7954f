"""Small logs of known content, ways to harm them, and what must be true of whatever is then read."""

import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from common.codec import encode_frame
from common.messages import Fix, Frame
from shore.logbook.log_writer import new_log
from shore.logbook.mcap.damage import Loss
from shore.logbook.mcap.records import HEAD
from shore.logbook.mcap.scan import Scan
from shore.navigation.estimate import Estimate
from tests.strategies import frame_of

UTC_NS = 1_795_000_000_000_000_000
EACH_NS = 100_000_000
CONNECTED = {
    "boot_id": "0123456789abcdef",
    "next_seq": 0,
    "config": {"boat": {"id": "springer"}, "sensor": [{"id": "gps1", "role": "gps", "model": "nmea", "rate_hz": 1.0}]},
    "versions": {"wayfix": "0.1.0"},
}
START = {"kind": "start", "options": {"filters": ["fuzzy"]}, "connected": CONNECTED, "utc_ns": UTC_NS}


def frame(seq: int) -> Frame:
    t0_ns = 1_000_000_000 + EACH_NS * seq
    fix = Fix(sensor="gps1", t_ns=t0_ns, lat_deg=50.0 + seq / 1e4, lon_deg=-4.0)
    return frame_of(fix, seq=seq, t0_ns=t0_ns, t1_ns=t0_ns + EACH_NS)


def estimate(t_ns: int, seq: int = 0, name: str = "fuzzy", **fields: Any) -> dict[str, Any]:
    whole = Estimate(
        t_ns=t_ns, boot_id="0123456789abcdef", seq=seq, filter=name, names=("east_m", "north_m"), state=(1.0, seq / 3),
        covariance=(1.0, 0.0, 2.0), origin_lat_deg=50.0, origin_lon_deg=-4.0, lat_deg=50.0 + seq / 1e4, lon_deg=-4.0,
        heading_true_deg=12.3, sog_kn=2.0, cog_true_deg=None, sigma_east_m=1.0, sigma_north_m=1.4,
        sigma_heading_deg=1.0, aligned=True, aligned_parts=("position", "heading"), waiting=(), position_from="fix",
        position_since_ns=0, heading_from="compass", repairs=0, channels={},
    )  # fmt: skip
    return whole.as_record() | fields


def write(
    directory: Path,
    order: Iterable[int],
    sync_each: int = 10,
    utc_ns: int = UTC_NS,
    made: Callable[[int], Frame] = frame,
) -> tuple[Path, list[tuple[int, int]]]:
    """A closed log; and (file size, frames readable then) after each sync."""
    writer = new_log(directory, "springer", utc_ns)
    writer.write_session(START, utc_ns)
    synced = [(writer.path.stat().st_size, 0)]
    for count, seq in enumerate(order, 1):
        one, t_ns = made(seq), utc_ns + EACH_NS * count
        writer.write_frame(encode_frame(one), one, t_ns)
        writer.write_estimate(estimate(one.t1_ns, seq), t_ns)
        if count % sync_each == 0:
            writer.sync()
            synced.append((writer.path.stat().st_size, count))
    writer.close()
    return writer.path, synced


@cache
def log_bytes(frames: int, sync_each: int = 10) -> bytes:
    """A closed log with a chunk every `sync_each` frames."""
    import tempfile

    with tempfile.TemporaryDirectory() as directory:
        return write(Path(directory), range(frames), sync_each)[0].read_bytes()


@dataclass(frozen=True)
class Seen:
    """What a scan of some bytes gives."""

    messages: list[tuple[str, int, int, int, bytes]]
    others: list[Any]
    scan: Scan

    @property
    def losses(self) -> list[Loss]:
        return [*self.scan.losses, *([self.scan.cut] if self.scan.cut else [])]


def seen(content: bytes, *, check_index: bool = False) -> Seen:
    scan = Scan(io.BytesIO(content), check_index=check_index)
    messages: list[tuple[str, int, int, int, bytes]] = []
    others = []
    for item in scan.items():
        if isinstance(item, tuple):
            assert item[0] is not None
            messages.append((item[0].topic, *item[1:]))
        else:
            others.append(item)
    return Seen(messages, others, scan)


def records_of(content: bytes) -> list[tuple[int, int, int]]:
    """(type, first byte, end) of each top-level record of a sound file."""
    at, found = 8, []
    while at < len(content) - 8:
        opcode, length = HEAD.unpack_from(content, at)
        found.append((opcode, at, at + HEAD.size + length))
        at += HEAD.size + length
    return found


def chunks_of(content: bytes) -> list[tuple[int, int]]:
    return [(at, end) for opcode, at, end in records_of(content) if opcode == 6]


def check_against(truth: Seen, harmed: Seen, *, is_counted: bool = True) -> list[tuple[str, int, int, int, bytes]]:
    """Whatever was harmed: no wrong record, none twice, and what is lost lies inside a span that is named.

    is_counted: where a number of lost records is given, it is right. Returns the lost records.
    """
    rest = iter(truth.messages)
    assert all(message in rest for message in harmed.messages), "a record that was never written, or out of order"
    kept = set(harmed.messages)
    lost = [message for message in truth.messages if message not in kept]
    for message in lost:
        t_ns = message[2]
        assert any(
            (loss.start_ns is None or loss.start_ns <= t_ns) and (loss.end_ns is None or t_ns <= loss.end_ns)
            for loss in harmed.losses
        ), "a loss that is not named, or with a wrong span"
    known = [loss.records for loss in harmed.losses if loss.records is not None]
    if is_counted and len(known) == len(harmed.losses):
        assert sum(known) == len(lost)
    return lost


def other_writer(
    *,
    compression: CompressionType = CompressionType.ZSTD,
    topics: tuple[str, ...] = ("/a", "/b"),
    repeats: bool = False,
    **options: Any,
) -> bytes:
    """A log of another program: two channels, metadata, an attachment."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=400, compression=compression, **options)
    writer.start(profile="other", library="test")
    schema = writer.register_schema("thing", "jsonschema", b"{}")
    channels = [writer.register_channel(topic, "json", schema, {"unit": "m"}) for topic in topics]
    writer.add_metadata("about", {"who": "somebody"})
    for number in range(60):
        if repeats and number % 10 == 0:  # a writer that says in each chunk what its channels are
            writer.flush()  # type: ignore[no-untyped-call]
            writer._Writer__chunk_builder.add_schema(writer._Writer__schemas[schema])  # type: ignore[attr-defined]
            for key in channels:
                writer._Writer__chunk_builder.add_channel(writer._Writer__channels[key])  # type: ignore[attr-defined]
        channel = channels[number % len(channels)]
        writer.add_message(channel, UTC_NS + number * EACH_NS, b'{"n":%d}' % number, number, number)
    writer.add_attachment(UTC_NS, UTC_NS, "chart.txt", "text/plain", b"rocks " * 40)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()
