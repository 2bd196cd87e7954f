"""Foxglove message schemas: records in the form that Foxglove's programs draw without any help of ours.

Written by hand after https://docs.foxglove.dev/docs/visualization/message-schemas; further properties are ours.
"""

from typing import Any, Final

from common.messages import Event
from common.units import NS_PER_S

LOCATION_FIX: Final = "foxglove.LocationFix"
LOG: Final = "foxglove.Log"
KNOWN, DIAGONAL, UNKNOWN = 3, 2, 0
"""Values of `position_covariance_type`: covariance known, only its diagonal known, unknown."""
_LEVELS: Final = {"debug": 1, "info": 2, "warning": 3, "error": 4}
LEVEL_NUMBERS: Final = {0: "info", **{number: word for word, number in _LEVELS.items()}, 5: "error"}
"""Level number -> our word; only other programs write the levels unknown (0) and fatal (5)."""
_STAMP: Final = {
    "type": "object",
    "title": "time",
    "description": "UTC by the boat where it knows it, else that of the station when it arrived",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
    "required": ["sec", "nsec"],
}

LOCATION_FIX_PROPERTIES: Final[dict[str, Any]] = {
    "timestamp": _STAMP,
    "frame_id": {"type": "string", "description": "sensor or filter"},
    "latitude": {"type": "number", "description": "deg, north +"},
    "longitude": {"type": "number", "description": "deg, east +"},
    "altitude": {"type": "number", "description": "m"},
    "position_covariance": {
        "type": "array",
        "items": {"type": "number"},
        "minItems": 9,
        "maxItems": 9,
        "description": "m^2, east, north, up, row by row",
    },
    "position_covariance_type": {"type": "integer", "enum": [0, 1, 2, 3]},
    "t_ns": {"type": "integer", "description": "nanoseconds on the boat clock"},
}
LOG_PROPERTIES: Final[dict[str, Any]] = {
    "timestamp": _STAMP,
    "level": {"type": "integer", "enum": [0, 1, 2, 3, 4, 5], "description": "debug 1, info 2, warning 3, error 4"},
    "message": {"type": "string"},
    "name": {"type": "string", "description": "the sensor or part concerned"},
    "file": {"type": "string"},
    "line": {"type": "integer", "minimum": 0},
    "t_ns": {"type": "integer", "description": "nanoseconds on the boat clock"},
    "code": {"type": "string"},
    "evidence": {"type": "object"},
}


def stamp(utc_ns: int) -> dict[str, int]:
    """A time as Foxglove writes it."""
    return {"sec": utc_ns // NS_PER_S, "nsec": utc_ns % NS_PER_S}


def location_fix(
    utc_ns: int, t_ns: int, source: str, place: tuple[float, float], covariance_m2: tuple[float, float, float] | None
) -> dict[str, Any]:
    """A `foxglove.LocationFix`. place: lat, lon in deg; covariance: east, east-north, north, or unknown."""
    east, cross, north = covariance_m2 or (0.0, 0.0, 0.0)
    return {
        "timestamp": stamp(utc_ns),
        "frame_id": source,
        "latitude": place[0],
        "longitude": place[1],
        "position_covariance": [east, cross, 0.0, cross, north, 0.0, 0.0, 0.0, 0.0],
        "position_covariance_type": UNKNOWN if covariance_m2 is None else KNOWN,
        "t_ns": t_ns,
    }


def log_record(event: Event, utc_ns: int) -> dict[str, Any]:
    """A `foxglove.Log` that holds the whole event."""
    return {
        "timestamp": stamp(utc_ns),
        "level": _LEVELS[event.level],
        "message": event.text,
        "name": event.source,
        "file": "",
        "line": 0,
        "t_ns": event.t_ns,
        "code": event.code,
        "evidence": event.evidence,
    }


def event_of(record: dict[str, Any]) -> dict[str, Any]:
    """The fields of the `Event` in a sound record of `/events` (`record_checks.py`), of this form or the first."""
    evidence = record.get("evidence") or {}
    if "message" not in record:
        return {name: record[name] for name in ("t_ns", "source", "code", "level", "text")} | {"evidence": evidence}
    return {
        "t_ns": record["t_ns"],
        "source": record["name"],
        "code": record["code"],
        "level": LEVEL_NUMBERS[record["level"]],
        "text": record["message"],
        "evidence": evidence,
    }
