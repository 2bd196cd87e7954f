"""Topics of a log and the JSON schemas of its channels, written by hand (docs/log-format.md shows them to people)."""

import json
from typing import Any, Final

from common.messages import LEVELS

FRAMES: Final = "/frames"
ESTIMATES: Final = "/estimates/"
"""+ name of the filter: one channel for each."""
EVENTS: Final = "/events"
SESSION: Final = "/session"
LINK: Final = "/link"

_TIME: Final = {"type": "integer", "description": "nanoseconds on the boat clock"}
_NUMBER: Final = {"type": ["number", "null"]}
_NUMBERS: Final = {"type": "array", "items": _NUMBER}

_SCHEMAS: Final[dict[str, tuple[str, dict[str, Any], tuple[str, ...]]]] = {
    ESTIMATES: (
        "wayfix.Estimate",
        {
            "filter": {"type": "string"},
            "t_ns": _TIME,
            "boot_id": {"type": "string", "description": "with seq: the frame that caused it"},
            "seq": {"type": "integer"},
            "names": {"type": "array", "items": {"type": "string"}, "description": "of state, with units"},
            "state": _NUMBERS,
            "covariance": {**_NUMBERS, "description": "upper triangle, row by row, in the units of names"},
            "origin_lat_deg": _NUMBER,
            "origin_lon_deg": _NUMBER,
            "lat_deg": _NUMBER,
            "lon_deg": _NUMBER,
            "heading_true_deg": {**_NUMBER, "description": "clockwise from true north, [0, 360)"},
            "sog_kn": _NUMBER,
            "cog_true_deg": {**_NUMBER, "description": "null while the speed is below its own sigma"},
            "sigma_east_m": {**_NUMBER, "description": "1-sigma"},
            "sigma_north_m": {**_NUMBER, "description": "1-sigma"},
            "sigma_heading_deg": {**_NUMBER, "description": "1-sigma"},
            "aligned": {"type": "boolean", "description": "valid: nothing is waited for"},
            "waiting": {"type": "array", "items": {"type": "string"}, "description": "what is not known yet"},
            "repairs": {"type": "integer"},
            "channels": {"type": "object", "description": "sensor.channel -> sigma, dom_ratio, nis"},
        },
        ("filter", "t_ns"),
    ),
    EVENTS: (
        "wayfix.Event",
        {
            "t_ns": _TIME,
            "source": {"type": "string"},
            "code": {"type": "string"},
            "level": {"enum": list(LEVELS)},
            "text": {"type": "string"},
            "evidence": {"type": "object"},
        },
        ("t_ns", "source", "code", "level", "text"),
    ),
    SESSION: ("wayfix.Session", {"kind": {"type": "string"}}, ("kind",)),
    LINK: ("wayfix.Link", {"kind": {"type": "string"}}, ("kind",)),
}


def json_schema(topic: str) -> tuple[str, bytes]:
    """(schema name, JSON Schema) of a topic; further properties are allowed everywhere."""
    name, properties, required = _SCHEMAS[ESTIMATES if topic.startswith(ESTIMATES) else topic]
    schema = {"title": name, "type": "object", "properties": properties, "required": list(required)}
    return name, json.dumps(schema).encode()
