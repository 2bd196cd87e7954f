"""MCAP for programs that draw (Foxglove, Lichtblick, PlotJuggler): JSON channels only, valid positions at full rate.

`/position/<filter>` and `/fixes/<sensor>` are foxglove.LocationFix with covariance, `/events` foxglove.Log,
`/estimates/<filter>` wayfix.Estimate. Times are UTC; where that is not known, nanoseconds of the log from 1970 on.
"""

import json
from collections.abc import Iterator
from heapq import merge
from typing import Any, BinaryIO, Final, NamedTuple

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from common.messages import Event
from common.units import NS_PER_S
from shore.exports.track import RAW, ExportTrack, Mark, Row
from shore.logbook import foxglove
from shore.logbook.estimate_rounding import logged
from shore.logbook.schemas import ESTIMATES, EVENTS, FIXES, POSITIONS, TRIP, json_schema

LIBRARY: Final = "wayfix-export"
"""Name in the header of the file, by which an export differs from a log."""


_LAST_NS: Final = 2**64 - 1


class _Message(NamedTuple):
    """One record, sortable by the time it is shown at."""

    time_ns: int
    topic: str
    record: dict[str, Any]
    data: bytes | None = None
    """The encoded record; `None` where it has not been encoded yet."""


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """Write the track as MCAP. Raises OSError."""
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start(profile="", library=LIBRARY)
    channels: dict[str, int] = {}
    for message in merge(_of_track(track), _of_fixes(track), key=lambda message: message.time_ns):
        if message.topic not in channels:
            name, text = json_schema(message.topic)
            schema = writer.register_schema(name, SchemaEncoding.JSONSchema, text)
            channels[message.topic] = writer.register_channel(message.topic, MessageEncoding.JSON, schema)
        data = message.data or json.dumps(message.record, separators=(",", ":"), allow_nan=False).encode()
        writer.add_message(channels[message.topic], message.time_ns, data, message.time_ns)
    writer.add_metadata(TRIP, {"name": track.title, "boat": track.survey.boat or "", "filter": track.filter})
    writer.finish()  # type: ignore[no-untyped-call]


def _of_track(track: ExportTrack) -> Iterator[_Message]:
    for item in track.items():
        time_ns = _time_ns(item.utc_ns, item.t_s)
        if isinstance(item, Mark):
            event = Event(
                t_ns=item.t_ns, source=item.source, code=item.code, level=item.level, text=item.text,
                evidence=item.evidence,
            )  # fmt: skip
            yield _Message(time_ns, EVENTS, foxglove.log_record(event, time_ns))
        elif item.record is not None:
            if "position" in item.aligned_parts:
                yield _Message(time_ns, f"{POSITIONS}{track.filter}", _position(track, item, time_ns))
            stored = item.record if item.data else logged(item.record)
            yield _Message(time_ns, f"{ESTIMATES}{track.filter}", stored, item.data)
        else:
            yield _Message(time_ns, f"{POSITIONS}{RAW}", _position(track, item, time_ns))


def _position(track: ExportTrack, row: Row, time_ns: int) -> dict[str, Any]:
    return foxglove.location_fix(time_ns, row.t_ns, track.filter, (row.lat_deg, row.lon_deg), row.covariance_m2)


def _of_fixes(track: ExportTrack) -> Iterator[_Message]:
    """Every usable fix; its covariance is what the configuration says of the receiver."""
    sigmas = {str(table["id"]): table.get("sigma_m") for table in track.survey.sensors("gps")}
    for clock, fix in track.fixes():
        if not fix.usable:
            continue
        assert fix.lat_deg is not None
        assert fix.lon_deg is not None
        sigma_m = sigmas.get(fix.sensor)
        covariance = None if sigma_m is None else (sigma_m**2, 0.0, sigma_m**2)
        time_ns = _time_ns(clock.utc_ns(fix.t_ns), clock.seconds(fix.t_ns))
        record = foxglove.location_fix(time_ns, fix.t_ns, fix.sensor, (fix.lat_deg, fix.lon_deg), covariance)
        if covariance is not None:
            record["position_covariance_type"] = foxglove.DIAGONAL
        yield _Message(time_ns, f"{FIXES}{fix.sensor}", record)


def _time_ns(utc_ns: int | None, t_s: float) -> int:
    """Time as MCAP can hold it, ns; what was before the first frame stands at the time of that frame."""
    return min(max(round(t_s * NS_PER_S) if utc_ns is None else utc_ns, 0), _LAST_NS)
