"""Hypothesis strategies for every message, derived from the same annotations the codec obeys.

Times are whole microseconds and columns hold f32 values, so that a round trip is equal, not nearly equal.
"""

import dataclasses
import types
import typing
from typing import Annotated, Any, get_args, get_origin

from hypothesis import strategies as st

from common.field_bounds import MaxLength, OneOf, Range
from common.messages import (
    AisLine,
    Attitude,
    ClockPair,
    Event,
    Fix,
    Frame,
    Heading,
    ImuBlock,
    RadarTarget,
    RawLine,
    SensorHealth,
    TurnRate,
)

MESSAGES = (Fix, ImuBlock, Heading, TurnRate, Attitude, ClockPair, AisLine, RadarTarget, RawLine, SensorHealth, Event)

LIST_OF = {
    Fix: "fixes", ImuBlock: "imu", Heading: "headings", TurnRate: "turn_rates", Attitude: "attitudes",
    ClockPair: "clock_pairs", AisLine: "ais", RadarTarget: "radar", RawLine: "raw", SensorHealth: "health",
    Event: "events",
}  # fmt: skip
"""The frame's list for each message type."""

times_ns = st.integers(-(2**40), 2**52).map(lambda t_us: 1000 * t_us)
f32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
characters = st.characters(exclude_categories=["Cs"])


def texts(most: int = 20) -> st.SearchStrategy[str]:
    return st.text(characters, max_size=min(most, 20))


plain_values = (
    st.none()
    | texts()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
)


def values(hint: Any) -> st.SearchStrategy[Any]:
    """Values allowed by one annotation."""
    bounds: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *rest = get_args(hint)
        bounds = tuple(rest)
    origin = get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        arms = [arm for arm in get_args(hint) if arm is not type(None)]
        return plain_values if len(arms) > 1 else st.none() | values(arms[0])
    if origin is dict:
        return st.dictionaries(texts(), values(get_args(hint)[1]), max_size=3)
    if origin is tuple:
        return st.lists(messages(get_args(hint)[0]), max_size=2).map(tuple)
    limits = next((bound for bound in bounds if isinstance(bound, Range)), Range())
    if hint is float:
        return st.floats(limits.low, limits.high, allow_nan=False, allow_infinity=False)
    if hint is int:
        low = -(2**63) if limits.low is None else int(limits.low)
        return st.integers(low, 2**63 - 1 if limits.high is None else int(limits.high))
    if hint is bool:
        return st.booleans()
    choices = next((bound.choices for bound in bounds if isinstance(bound, OneOf)), None)
    longest = next((bound.count for bound in bounds if isinstance(bound, MaxLength)), 20)
    return st.sampled_from(choices) if choices else texts(longest)


def messages(cls: Any) -> st.SearchStrategy[Any]:
    """Valid messages of one class."""
    if cls is ImuBlock:
        return imu_blocks()
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = {field.name: values(hints[field.name]) for field in dataclasses.fields(cls)}
    for name in ("t_ns", "t0_ns", "t1_ns"):
        if name in fields:
            fields[name] = times_ns
    if "last_good_t_ns" in fields:
        fields["last_good_t_ns"] = st.none() | times_ns
    return st.builds(cls, **fields)


@st.composite
def imu_blocks(draw: st.DrawFn) -> ImuBlock:
    count = draw(st.integers(0, 12))
    hints = typing.get_type_hints(ImuBlock, include_extras=True)
    fields: dict[str, Any] = {}
    for name, hint in hints.items():
        if hint == tuple[float, ...]:
            fields[name] = tuple(draw(st.lists(f32, min_size=count, max_size=count)))
        elif hint == tuple[int, ...]:
            fields[name] = tuple(draw(st.lists(st.integers(0, 2**32 - 1), min_size=count, max_size=count)))
        else:
            fields[name] = draw(times_ns if name == "t_ns" else values(hint))
    return ImuBlock(**fields)


frames = messages(Frame)


def frame_of(*entries: Any, **fields: Any) -> Frame:
    """A small valid frame that carries `entries` in the lists of their types."""
    lists: dict[str, tuple[Any, ...]] = {}
    for entry in entries:
        name = LIST_OF[type(entry)]
        lists[name] = (*lists.get(name, ()), entry)
    base = {"boat_id": "b", "boot_id": "0123456789abcdef", "seq": 1, "clock_id": "c", "start_no": 1}
    return Frame(**{**base, "t0_ns": 1_000_000_000, "t1_ns": 1_100_000_000, **lists, **fields})


def numbered_frame(seq: int, *entries: Any, period_ns: int = 100_000_000, **fields: Any) -> Frame:
    """The frame of that number, counted from boat time 0 on in steps of the period."""
    return frame_of(*entries, **{"seq": seq, "t0_ns": seq * period_ns, "t1_ns": (seq + 1) * period_ns, **fields})


FIX = Fix(sensor="gps1", t_ns=1_000_000_000, lat_deg=50.0, lon_deg=-4.0)
BLOCK = ImuBlock(
    sensor="imu1", t_ns=1_000_000_000, offset_us=(0, 50_000), accel_fwd_m_s2=(0.5, 0.25),
    accel_stb_m_s2=(0.0, -0.5), yaw_rate_deg_s=(1.0, 2.0),
)  # fmt: skip


def required(field: "dataclasses.Field[Any]") -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def default(field: "dataclasses.Field[Any]") -> Any:
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def wire_key(name: str) -> str:
    return {"t_ns": "dt_us", "last_good_t_ns": "last_good_dt_us"}.get(name, name)


def sample(cls: Any) -> Any:
    """One valid message with nothing but its required fields."""
    texts = {"sensor": "s1", "source": "s1", "state": "silent", "level": "info", "code": "c", "text": "t"}
    numbers = {"t_ns": 1_000_000_000, "utc_ns": 5, "number": 7, "rate_deg_s": 1.0}
    pool = {**texts, **numbers}
    if cls is ImuBlock:
        return BLOCK
    return cls(**{f.name: pool.get(f.name, "x") for f in dataclasses.fields(cls) if required(f)})
