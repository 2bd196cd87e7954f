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

_SCHEMAS: Final[dict[str, tuple[str, dict[str, Any], tuple[str, ...]]]] = {
    ESTIMATES: (
        "wayfix.Estimate",
        {
            "filter": {"type": "string"},
            "t_ns": _TIME,
            "lat_deg": _NUMBER,
            "lon_deg": _NUMBER,
            "heading_true_deg": _NUMBER,
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
