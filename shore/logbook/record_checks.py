"""Schema validation of each JSON channel: the form that a record must have before any part of ours uses it.

    content = content_of("/events", data)       # raises FormError: level must be one of 0 to 5, got 'high'

One guard for every reader. What is missing is `None` or gets its default, so a log of an early form is read; what no
reader could use makes the whole record odd. NaN, which is no JSON, is missing too.
"""

import json
import math
import reprlib
import sys
from collections.abc import Callable
from operator import itemgetter
from typing import Any, Final, NamedTuple

from common.messages import LEVELS
from shore.logbook.foxglove import LEVEL_NUMBERS
from shore.logbook.schemas import ESTIMATES, EVENTS, LINK, SESSION

Record = dict[str, Any]


class FormError(ValueError):
    """A record has not the form of its channel; the text says where."""


class _Kind(NamedTuple):
    """What a value must be."""

    words: str
    holds: Callable[[Any], bool]


class _Maybe(NamedTuple):
    """A value that is missing, or has this form."""

    form: Any


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and abs(value) <= sys.float_info.max


def _is_angle(limit_deg: float) -> Callable[[Any], bool]:
    return lambda value: _is_number(value) and -limit_deg <= value <= limit_deg


def _is_list_of(holds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: type(value) is list and all(map(holds, value))


def _is_text(value: Any) -> bool:
    return type(value) is str


_TIME: Final = _Kind("a whole number of 64 bits", lambda value: type(value) is int and -(2**63) <= value < 2**63)
_TEXT: Final = _Kind("a text", _is_text)
_TEXTS: Final = _Kind("a list of texts", _is_list_of(_is_text))
_NUMBER: Final = _Kind("a number", _is_number)
_NUMBERS: Final = _Kind("a list of numbers", _is_list_of(lambda value: value is None or _is_number(value)))
_FLAG: Final = _Kind("true or false", lambda value: type(value) is bool)
_LIST: Final = _Kind("a list", lambda value: type(value) is list)
_OBJECT: Final[Record] = {}

_ESTIMATE: Final[Record] = {
    "filter": _TEXT,
    "t_ns": _TIME,
    "boot_id": _TEXT,
    "names": _TEXTS,
    "state": _NUMBERS,
    "covariance": _NUMBERS,
    "lat_deg": _Kind("a latitude", _is_angle(90.0)),
    "lon_deg": _Kind("a longitude", _is_angle(180.0)),
    "heading_true_deg": _Maybe(_NUMBER),
    "sog_kn": _Maybe(_NUMBER),
    "cog_true_deg": _Maybe(_NUMBER),
    "sigma_east_m": _Maybe(_NUMBER),
    "sigma_north_m": _Maybe(_NUMBER),
    "sigma_heading_deg": _Maybe(_NUMBER),
    "aligned": _FLAG,
    "aligned_parts": _TEXTS,
    "waiting": _TEXTS,
    "position_from": _Maybe(_TEXT),
    "position_since_ns": _Maybe(_TIME),
    "heading_from": _Maybe(_TEXT),
    "channels": _OBJECT,
}
_ESTIMATE_DEFAULTS: Final[Record] = {
    "boot_id": "", "names": [], "state": [], "covariance": [], "heading_true_deg": None, "sog_kn": None,
    "cog_true_deg": None, "sigma_east_m": None, "sigma_north_m": None, "sigma_heading_deg": None, "aligned": True,
    "waiting": [], "channels": {},
}  # fmt: skip
_EVENT: Final[Record] = {"t_ns": _TIME, "code": _TEXT, "evidence": _Maybe(_OBJECT)}
_FOXGLOVE_EVENT: Final[Record] = {
    **_EVENT,
    "name": _TEXT,
    "message": _TEXT,
    "level": _Kind("one of 0 to 5", lambda value: type(value) is int and value in LEVEL_NUMBERS),
}
_FIRST_EVENT: Final[Record] = {
    **_EVENT,
    "source": _TEXT,
    "text": _TEXT,
    "level": _Kind(f"one of {', '.join(LEVELS)}", lambda value: _is_text(value) and value in LEVELS),
}
_SENSOR: Final[Record] = {"id": _TEXT, "role": _Maybe(_TEXT), "sigma_m": _Maybe(_NUMBER)}
_CONFIG: Final[Record] = {"boat": _Maybe({"id": _Maybe(_TEXT)}), "sensor": _Maybe([_SENSOR])}
_SUMMARY: Final[Record] = {"filters": _Maybe(_LIST), "events": _Maybe(_OBJECT)}
_SESSIONS: Final[dict[str, Record]] = {
    "start": {
        "options": _Maybe({"filters": _Maybe(_TEXTS), "step_s": _Maybe(_NUMBER)}),
        "connected": _Maybe({"config": _Maybe(_CONFIG), "file": _Maybe(_OBJECT), "versions": _Maybe(_OBJECT)}),
        "versions": _Maybe(_OBJECT),
        "arithmetic": _Maybe(_OBJECT),
        "utc_ns": _Maybe(_TIME),
    },
    "trip": {"name": _Maybe(_TEXT), "place": _Maybe(_TEXT), "note": _Maybe(_TEXT)},
    "summary": _SUMMARY,
    "recovered": {"losses": _Maybe(_LIST), "summary": _Maybe(_SUMMARY)},
}
_KIND: Final[Record] = {"kind": _TEXT}

_raw_decode: Final = json.JSONDecoder(parse_constant=lambda _nan: None).raw_decode
_numbers: Final = itemgetter("lat_deg", "lon_deg", "sog_kn", "sigma_east_m", "sigma_north_m", "sigma_heading_deg")
_basis: Final = itemgetter("aligned_parts", "position_from", "position_since_ns", "heading_from")
_parts: Final = itemgetter("names", "state", "covariance", "waiting", "cog_true_deg", "heading_true_deg")


def content_of(topic: str, data: bytes) -> Record:
    """The content of a JSON record. Raises FormError when it has not the form of its channel."""
    content = _json(data)
    if topic.startswith(ESTIMATES):
        return _with_basis(content) if _is_quickly_sound(content) else _estimate(content)
    try:
        json.dumps(content, allow_nan=False)
    except ValueError:  # 1e999 is JSON
        raise FormError("holds a number that is not finite") from None
    if topic == EVENTS:
        _check(content, _FOXGLOVE_EVENT if "message" in content else _FIRST_EVENT)
    elif topic == SESSION:
        _check(content, _KIND)
        _check(content, _SESSIONS.get(content["kind"], _OBJECT))
    elif topic == LINK:
        _check(content, _KIND)
    return content


def _json(data: bytes) -> Record:
    try:
        text = data.decode().strip()
        content, end = _raw_decode(text)
        if "\\" in text:  # perhaps half a character, which no file can hold
            json.dumps(content, ensure_ascii=False).encode()
    except UnicodeError:
        raise FormError("holds what is no text") from None
    except (ValueError, RecursionError):
        raise FormError("is no JSON") from None
    if end != len(text):
        raise FormError("is no JSON")
    if type(content) is not dict:
        raise FormError(f"must be an object, got {reprlib.repr(content)}")
    return content


def _is_quickly_sound(content: Record) -> bool:
    """Whether an estimate is, without doubt, as our own writer makes it: spares the whole check, ten times as long.

    A sum is finite only when every number is, and nothing but numbers has one.
    """
    try:
        names, state, covariance, waiting, *directions = _parts(content)
        size = len(state)
        return (
            type(content["t_ns"]) is int
            and -(2**63) <= content["t_ns"] < 2**63
            and type(content["boot_id"]) is type(content["filter"]) is str
            and -90.0 <= content["lat_deg"] <= 90.0
            and -180.0 <= content["lon_deg"] <= 180.0
            and type(content["aligned"]) is bool
            and type(content["channels"]) is dict
            and type(names) is type(state) is type(covariance) is type(waiting) is list
            and len(names) == size
            and len(covariance) == size * (size + 1) // 2
            and math.isfinite(sum(_numbers(content)) + sum(each for each in directions if each is not None))
            and math.isfinite(sum(state))
            and math.isfinite(sum(covariance))
            and ("".join(names), "".join(waiting)) is not None
            and ("position_from" not in content or _has_sound_basis(content))
        )
    except (LookupError, TypeError, OverflowError):
        return False


def _has_sound_basis(content: Record) -> bool:
    parts, fix, since_ns, heading = _basis(content)
    return (
        type(parts) is list
        and "".join(parts) is not None
        and type(fix) is str
        and type(since_ns) is int
        and -(2**63) <= since_ns < 2**63
        and (heading is None or type(heading) is str)
    )


def _with_basis(content: Record) -> Record:
    """The estimate with what it rests on, which a form of before did not say: all of it was valid, or nothing."""
    if "position_from" in content:
        return content
    parts = ["position", "heading"] if content["aligned"] else []
    return {"aligned_parts": parts, "position_from": None, "position_since_ns": None, "heading_from": None, **content}


def _estimate(content: Record) -> Record:
    """The estimate with defaults for what an early form did not have."""
    whole = _with_basis(_ESTIMATE_DEFAULTS | content)
    _check(whole, _ESTIMATE)
    size = len(whole["state"])
    if len(whole["names"]) != size or len(whole["covariance"]) != size * (size + 1) // 2:
        raise FormError("names, state and covariance must be of one size")
    return whole


def _check(value: Any, form: Any, where: str = "") -> None:
    if isinstance(form, _Maybe):
        if value is not None:
            _check(value, form.form, where)
    elif isinstance(form, _Kind):
        if not form.holds(value):
            what = "is missing" if value is None else f"must be {form.words}, got {reprlib.repr(value)}"
            raise FormError(f"{where} {what}")
    elif type(value) is not type(form):
        raise FormError(f"{where} must be {'a list' if type(form) is list else 'an object'}, got {reprlib.repr(value)}")
    elif isinstance(form, dict):
        for name, inner in form.items():
            _check(value.get(name), inner, f"{where}.{name}" if where else name)
    else:
        for number, item in enumerate(value):
            _check(item, form[0], f"{where}[{number}]")
