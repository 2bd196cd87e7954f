"""Topics of a log and the JSON Schemas of its channels, written by hand (docs/log-format.md shows them to people)."""

import json
from typing import Any, Final

from shore.logbook import foxglove

FRAMES: Final = "/frames"
ESTIMATES: Final = "/estimates/"
"""Prefix of the topics of estimates; the name of the filter follows, one channel for each."""
EVENTS: Final = "/events"
SESSION: Final = "/session"
LINK: Final = "/link"
TRIP: Final = "wayfix.trip"
"""Name of the MCAP metadata record with the trip's summary."""
LATE: Final = "-late"
"""Behind the name of a trip: frames of it that came after its end, until they are put into its log."""
LATE_OF: Final = "late_of"
"""In the start record of such a log: the name of the trip. A boat whose id ends in LATE has trips of such names."""
FIXES: Final = "/fixes/"
"""Prefix of the topics of fixes as Foxglove draws them; the sensor's id follows."""
POSITIONS: Final = "/position/"
"""Prefix of the topics of positions as Foxglove draws them, at most one a second; the name of the filter follows."""

_TIME: Final = {"type": "integer", "description": "nanoseconds on the boat clock"}
_NUMBER: Final = {"type": ["number", "null"]}
_PLACE: Final = ("timestamp", "frame_id", "latitude", "longitude")
_NUMBERS: Final = {"type": "array", "items": _NUMBER}
_TEXTS: Final = {"type": "array", "items": {"type": "string"}}

_SCHEMAS: Final[dict[str, tuple[str, dict[str, Any], tuple[str, ...]]]] = {
    ESTIMATES: (
        "wayfix.Estimate",
        {
            "filter": {"type": "string"},
            "t_ns": _TIME,
            "boot_id": {"type": "string", "description": "with seq: the frame that caused it"},
            "seq": {"type": "integer"},
            "names": {**_TEXTS, "description": "of state, with units"},
            "state": _NUMBERS,
            "covariance": {**_NUMBERS, "description": "upper triangle, row by row, in the units of names"},
            "origin_lat_deg": _NUMBER,
            "origin_lon_deg": _NUMBER,
            "lat_deg": _NUMBER,
            "lon_deg": _NUMBER,
            "heading_true_deg": {**_NUMBER, "description": "clockwise from true north, [0, 360); null = not known"},
            "sog_kn": _NUMBER,
            "cog_true_deg": {**_NUMBER, "description": "null while the speed is below its own sigma"},
            "sigma_east_m": {**_NUMBER, "description": "1-sigma"},
            "sigma_north_m": {**_NUMBER, "description": "1-sigma"},
            "sigma_heading_deg": {**_NUMBER, "description": "1-sigma"},
            "aligned": {"type": "boolean", "description": "all parts are valid: nothing is waited for"},
            "waiting": {**_TEXTS, "description": "what is not known yet"},
            "aligned_parts": {**_TEXTS, "description": "what is valid: position (with the velocity), heading"},
            "position_from": {"type": "string", "description": "fix, or coasting (dead reckoning)"},
            "position_since_ns": {**_TIME, "description": "first fix of the row; while coasting, the last fix"},
            "heading_from": {"type": ["string", "null"], "description": "compass, course or coasting"},
            "repairs": {"type": "integer"},
            "channels": {"type": "object", "description": "sensor.channel -> sigma, dom_ratio, nis"},
            "digest": {"type": "string", "description": "of all bits before numbers were rounded for the log"},
        },
        ("filter", "t_ns"),
    ),
    EVENTS: (foxglove.LOG, foxglove.LOG_PROPERTIES, ("timestamp", "level", "message", "name", "t_ns", "code")),
    FIXES: (foxglove.LOCATION_FIX, foxglove.LOCATION_FIX_PROPERTIES, _PLACE),
    POSITIONS: (foxglove.LOCATION_FIX, foxglove.LOCATION_FIX_PROPERTIES, _PLACE),
    SESSION: ("wayfix.Session", {"kind": {"type": "string"}}, ("kind",)),
    LINK: ("wayfix.Link", {"kind": {"type": "string"}}, ("kind",)),
}


def json_schema(topic: str) -> tuple[str, bytes]:
    """(schema name, JSON Schema) of a topic; further properties are allowed everywhere."""
    many = next((kind for kind in (ESTIMATES, FIXES, POSITIONS) if topic.startswith(kind)), topic)
    name, properties, required = _SCHEMAS[many]
    schema = {"title": name, "type": "object", "properties": properties, "required": list(required)}
    return name, json.dumps(schema).encode()
