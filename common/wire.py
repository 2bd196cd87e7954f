"""Wire types: from a field's annotation to the functions that check and convert it (used by `common.codec`).

A converter takes (value, t0_ns of the frame) and returns the checked value or raises Fault. Most are the same for both
directions; times and lists come in pairs (encode, decode).
"""

import math
import reprlib
import sys
import types
import typing
from collections.abc import Callable
from typing import Annotated, Any, Final, get_args, get_origin

from common.field_bounds import MaxLength, OneOf, Range
from common.units import NS_PER_US

MAX_ENTRIES: Final = 8192
"""Most entries of one list or map."""
MAX_TEXT: Final = 4096
"""Most characters of a text, where a field names no smaller limit."""

_INT_LOW: Final = -(2**63)
_INT_HIGH: Final = 2**63 - 1

Convert = Callable[[Any, int], Any]


class Fault(Exception):  # noqa: N818 - never leaves the codec
    """What is wrong; each level on the way out puts its name in front of the path."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.text = text
        self.path = ""

    def under(self, name: str) -> "Fault":
        """This fault, one level further out."""
        joint = "." if self.path and not self.path.startswith("[") else ""
        self.path = f"{name}{joint}{self.path}"
        return self

    def __str__(self) -> str:
        return f"{self.path or 'frame'}: {self.text}"


def wrong_type(wanted: str, value: Any) -> Fault:
    """`value` is shown shortened, however large it is."""
    return Fault(f"must be {wanted}, got {reprlib.repr(value)}")


def value_converter(hint: Any) -> Convert:
    """The converter of a scalar or map, both ways; None, columns, messages and lists of messages are the codec's."""
    bounds: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *rest = get_args(hint)
        bounds = tuple(rest)
    origin = get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        arms = [arm for arm in get_args(hint) if arm is not type(None)]
        if len(arms) > 1:
            return _plain
        return value_converter(arms[0])
    if origin is dict:
        return _dict(value_converter(get_args(hint)[1]))
    return _SCALARS[hint](bounds)


def _number_bounds(bounds: tuple[Any, ...], low: Any, high: Any) -> tuple[Range, Any, Any]:
    limits = next((bound for bound in bounds if isinstance(bound, Range)), Range())
    return limits, low if limits.low is None else limits.low, high if limits.high is None else limits.high


def _float(bounds: tuple[Any, ...]) -> Convert:
    # Finite limits refuse NaN and infinity in the same comparison.
    limits, low, high = _number_bounds(bounds, -sys.float_info.max, sys.float_info.max)

    def check(value: Any, _t0_ns: int) -> float:
        number = value if type(value) is float else _as_float(value)
        if low <= number <= high:
            return number
        if not math.isfinite(number):
            raise Fault(f"must be finite, got {number}")
        raise Fault(limits.fault(number) or "out of range")

    return check


def _as_float(value: Any) -> float:
    if isinstance(value, int | float) and type(value) is not bool:
        try:
            return float(value)
        except OverflowError:
            pass
    raise wrong_type("a finite number", value)


def _int(bounds: tuple[Any, ...]) -> Convert:
    limits, low, high = _number_bounds(bounds, _INT_LOW, _INT_HIGH)

    def check(value: Any, _t0_ns: int) -> int:
        if type(value) is not int:
            raise wrong_type("a whole number", value)
        if low <= value <= high:
            return value
        if not _INT_LOW <= value <= _INT_HIGH:
            raise Fault("must fit in 64 bits")
        raise Fault(limits.fault(value) or "out of range")

    return check


def _text(bounds: tuple[Any, ...]) -> Convert:
    longest = next((bound.count for bound in bounds if isinstance(bound, MaxLength)), MAX_TEXT)
    choices = next((bound.choices for bound in bounds if isinstance(bound, OneOf)), None)

    def check(value: Any, _t0_ns: int) -> str:
        if type(value) is not str:
            raise wrong_type("a text", value)
        if choices is not None and value not in choices:
            raise Fault(f"must be one of {', '.join(choices)}, got {reprlib.repr(value)}")
        if len(value) > longest:
            raise Fault(f"must be at most {longest} characters, got {len(value)}")
        return value

    return check


def _bool(_bounds: tuple[Any, ...]) -> Convert:
    def check(value: Any, _t0_ns: int) -> bool:
        if type(value) is not bool:
            raise wrong_type("true or false", value)
        return value

    return check


_SCALARS: Final[dict[Any, Callable[[tuple[Any, ...]], Convert]]] = {
    float: _float,
    int: _int,
    str: _text,
    bool: _bool,
}
_PLAIN: Final = {kind: make(()) for kind, make in _SCALARS.items()}


def _plain(value: Any, t0_ns: int) -> Any:
    """A value of an event's evidence: text, number, bool or None."""
    if value is None:
        return None
    check = _PLAIN.get(type(value))
    if check is None:
        raise wrong_type("a text, a number, true, false or nothing", value)
    return check(value, t0_ns)


def _dict(item: Convert) -> Convert:
    text = _text(())

    def convert(value: Any, t0_ns: int) -> dict[str, Any]:
        if type(value) is not dict:
            raise wrong_type("a map", value)
        if len(value) > MAX_ENTRIES:
            raise Fault(f"must have at most {MAX_ENTRIES} entries, got {len(value)}")
        entries = {}
        for name, entry in value.items():
            try:
                entries[text(name, t0_ns)] = item(entry, t0_ns)
            except Fault as fault:
                raise fault.under(f"[{reprlib.repr(name)}]") from None
        return entries

    return convert


def list_converter(item: Convert, kind: "type[tuple[Any, ...] | list[Any]]") -> Convert:
    """Every entry through `item`; `kind` (tuple in memory, list on the wire) is what comes in, the other goes out."""
    other: Any = list if kind is tuple else tuple

    def convert(values: Any, t0_ns: int) -> Any:
        if not isinstance(values, kind):
            raise wrong_type("a list", values)
        if len(values) > MAX_ENTRIES:
            raise Fault(f"must have at most {MAX_ENTRIES} entries, got {len(values)}")
        items = []
        for value in values:
            try:
                items.append(item(value, t0_ns))
            except Fault as fault:
                raise fault.under(f"[{len(items)}]") from None
        return other(items)

    return convert


def encode_time(t_ns: Any, t0_ns: int) -> int:
    """`t_ns` -> signed whole microseconds since `t0_ns`."""
    return (whole_us_time(t_ns, 0) - t0_ns) // NS_PER_US


def decode_time(dt_us: Any, t0_ns: int) -> int:
    """Signed microseconds since `t0_ns` -> `t_ns`."""
    if type(dt_us) is not int:
        raise wrong_type("a whole number", dt_us)
    return whole_us_time(t0_ns + dt_us * NS_PER_US, 0)


def whole_us_time(t_ns: Any, _t0_ns: int) -> int:
    """A time in ns that fits in 64 bits and is whole microseconds."""
    if type(t_ns) is not int:
        raise wrong_type("a whole number", t_ns)
    if not _INT_LOW <= t_ns <= _INT_HIGH:
        raise Fault("must fit in 64 bits")
    if t_ns % NS_PER_US:
        raise Fault(f"must be whole microseconds, got {t_ns} ns")
    return t_ns
