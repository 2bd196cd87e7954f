"""Quantisation (rounding) of estimates for the log, far below their own sigma, with a digest of every bit."""

import math
import struct
from collections.abc import Iterator
from hashlib import blake2b
from typing import Any, Final

from common.angles import heading_deg

Record = dict[str, Any]

DIGITS: Final = 5
"""Significant digits that are kept of covariances, sigmas and what the channels report."""
STATE_SHARE: Final = 3
"""Decimals kept below the 1-sigma of a number of the state: it is rounded to a thousandth of that."""
TOLERANCE: Final = 1e-9
"""How far the same calculation may come out elsewhere, in the unit of the number (m, m/s, rad, deg, kn ...): numbers of
the covariance in shares of the product of their two sigmas, those of the channels in shares of themselves above 1."""
PLACE_DECIMALS: Final = 9
"""Decimals of latitude and longitude (deg): the last one is 0.1 mm."""
BASIS: Final = ("aligned_parts", "position_from", "position_since_ns", "heading_from")
"""Fields that say what an estimate rests on. They are compared as they are: logs of before have the same digests."""
ANGLE_DECIMALS: Final = 5
_NAN: Final = math.nan


def logged(record: Record) -> Record:
    """What is stored of `Estimate.as_record()`: the same fields, rounded, and `digest`.

    The 8-hour log of a small boat is half as large for it. A replay compares digests, so equality is still bit for bit.
    """
    return {
        **record,
        "state": _state(record),
        "covariance": [_digits(value) for value in record["covariance"]],
        "origin_lat_deg": round(record["origin_lat_deg"], PLACE_DECIMALS),
        "origin_lon_deg": round(record["origin_lon_deg"], PLACE_DECIMALS),
        "lat_deg": round(record["lat_deg"], PLACE_DECIMALS),
        "lon_deg": round(record["lon_deg"], PLACE_DECIMALS),
        "heading_true_deg": _direction(record["heading_true_deg"]),
        "cog_true_deg": _direction(record["cog_true_deg"]),
        "sog_kn": _digits(record["sog_kn"]),
        "sigma_east_m": _digits(record["sigma_east_m"]),
        "sigma_north_m": _digits(record["sigma_north_m"]),
        "sigma_heading_deg": _digits(record["sigma_heading_deg"]),
        "channels": {
            channel: {name: _digits(value) for name, value in report.items()}
            for channel, report in record["channels"].items()
        },
        "digest": digest_of(record),
    }


def is_stored_in(data: bytes, record: Record) -> bool:
    """True when the JSON of a log's estimate holds digest, state, place, heading and alignment of `record`.

    It looks for their text, because to read the JSON or to round the covariance costs more than all the rest. False may
    also mean that another program wrote the JSON in another way.
    """
    state = str(_state(record)).replace(" ", "")
    lat_deg, lon_deg = round(record["lat_deg"], PLACE_DECIMALS), round(record["lon_deg"], PLACE_DECIMALS)
    says_basis = b'"position_from":' in data
    heading_deg = _direction(record["heading_true_deg"] if says_basis else heading_of(record))
    heading = "null" if heading_deg is None else heading_deg
    aligned = b'"aligned":true,' if record["aligned"] else b'"aligned":false,'
    return (
        digest_of(record).encode() in data
        and f'"state":{state},'.encode() in data
        and f'"lat_deg":{lat_deg},"lon_deg":{lon_deg},"heading_true_deg":{heading},'.encode() in data
        and aligned in data
        and (not says_basis or _basis_text(*(record[name] for name in BASIS)).encode() in data)
    )


def _basis_text(parts: tuple[str, ...], position: str, since_ns: int, heading: str | None) -> str:
    """`BASIS` as our writer has it."""
    words = str([*parts]).replace("'", '"').replace(" ", "")
    heading_word = "null" if heading is None else f'"{heading}"'
    return (
        f'"aligned_parts":{words},"position_from":"{position}","position_since_ns":{since_ns},'
        f'"heading_from":{heading_word},'
    )


def as_before(record: Record) -> Record:
    """An estimate in the form that did not say what it rests on, and gave a heading whatever its doubt."""
    return {name: value for name, value in record.items() if name not in BASIS} | {
        "heading_true_deg": heading_of(record)
    }


def heading_of(record: Record) -> float | None:
    """The heading that the filter works with, deg, be it shown or not; `None` where the state has none."""
    if record["heading_true_deg"] is not None or "heading_rad" not in record["names"]:
        return record["heading_true_deg"]  # type: ignore[no-any-return]
    return heading_deg(record["state"][record["names"].index("heading_rad")])


def _state(record: Record) -> list[float]:
    variances = _diagonal(record["covariance"], len(record["state"]))
    return [_below(value, variance) for value, variance in zip(record["state"], variances, strict=True)]


def digest_of(record: Record) -> str:
    """16 hex digits over every number and word of `Estimate.as_record()` but `BASIS`; a stored record says its own."""
    if "digest" in record:
        return str(record["digest"])
    numbers = list(_numbers(record))
    words = [record["filter"], record["boot_id"], *record["names"], *record["waiting"], *record["channels"]]
    whole = (record["t_ns"], record["seq"], record["repairs"], record["aligned"])
    digest = blake2b(struct.pack(f"<{len(numbers)}d", *numbers), digest_size=8)
    digest.update(f"{whole} {words}".encode())
    return digest.hexdigest()


def is_near(record: Record, recorded: Record) -> bool:
    """True when what was recorded is what numbers within `TOLERANCE` of those of `Estimate.as_record()` are stored as.

    All words and whole numbers must be equal. The digest is not looked at.
    """
    if recorded.get("position_from") is None:
        record = as_before(record)
    stored_as = logged if "digest" in recorded else dict  # logs of the first form are not rounded
    # A variance decides how a number of the state is rounded, so that it is moved apart from the numbers.
    moves = [(by, of_variance) for by in (-TOLERANCE, TOLERANCE) for of_variance in (-TOLERANCE, TOLERANCE)]
    near = [stored_as(_moved(record, *move)) for move in moves]
    return (
        all(
            _is_among([each[name] for each in near], value)
            for name, value in _turned(record, recorded).items()
            if name in record
        )
        and record.keys() <= recorded.keys()
    )


def _turned(record: Record, recorded: Record) -> Record:
    """What was recorded; a heading of due south, which is stored as pi or -pi, on the side of the other one."""
    if "heading_rad" not in record["names"] or len(recorded.get("state") or ()) != len(record["state"]):
        return recorded
    place = record["names"].index("heading_rad")
    ours, theirs = record["state"][place], recorded["state"][place]
    if math.pi - abs(ours) > TOLERANCE or not isinstance(theirs, float):
        return recorded
    turned = math.copysign(theirs, ours)
    return {**recorded, "state": [*recorded["state"][:place], turned, *recorded["state"][place + 1 :]]}


def _is_among(near: list[Any], recorded: Any) -> bool:
    """True when a number lies between those that are near, or anything else is equal to them."""
    first = near[0]
    if isinstance(first, dict):
        return isinstance(recorded, dict) and all(
            _is_among([each[key] for each in near], recorded.get(key)) for key in first
        )
    if isinstance(first, list):
        return (
            isinstance(recorded, list)
            and len(recorded) == len(first)
            and all(map(_is_among, map(list, zip(*near, strict=True)), recorded))
        )
    if isinstance(first, float):
        return isinstance(recorded, int | float) and min(near) <= recorded <= max(near)
    return bool(first == recorded)


def _moved(record: Record, by: float, of_variance: float) -> Record:
    """The estimate with all numbers moved; `of_variance` moves the covariance."""
    size = len(record["state"])
    sigmas = [math.sqrt(abs(variance)) for variance in _diagonal(record["covariance"], size)]
    products = [sigmas[row] * sigmas[column] for row in range(size) for column in range(row, size)]
    whole = {name: value + by for name, value in record.items() if isinstance(value, float)}
    return {
        **record,
        **whole,
        "state": [value + by for value in record["state"]],
        "covariance": [
            value + of_variance * scale for value, scale in zip(record["covariance"], products, strict=True)
        ],
        "channels": {
            channel: {
                name: value + by * max(1.0, abs(value)) if value is not None else None for name, value in report.items()
            }
            for channel, report in record["channels"].items()
        },
    }


def _numbers(record: Record) -> Iterator[float]:
    yield from record["state"]
    yield from record["covariance"]
    for name in ("origin_lat_deg", "origin_lon_deg", "lat_deg", "lon_deg"):
        yield record[name]
    heading = heading_of(record)
    yield _NAN if heading is None else heading
    yield record["sog_kn"]
    for name in ("sigma_east_m", "sigma_north_m", "sigma_heading_deg"):
        yield record[name]
    yield _NAN if record["cog_true_deg"] is None else record["cog_true_deg"]
    for report in record["channels"].values():
        for name in ("sigma", "dom_ratio", "nis"):
            yield _NAN if report[name] is None else report[name]


def _diagonal(covariance: list[float], size: int) -> list[float]:
    """Diagonal of an upper triangle that is stored row by row."""
    return [covariance[row * size - row * (row - 1) // 2] for row in range(size)]


def _below(value: float, variance: float) -> float:
    """A value rounded to a thousandth of its 1-sigma, in whole decimals."""
    return round(value, STATE_SHARE - math.floor(0.5 * math.log10(variance))) if variance > 0.0 else value


def _direction(value_deg: float | None) -> float | None:
    """A direction that is within [0, 360) after rounding too."""
    return None if value_deg is None else round(value_deg, ANGLE_DECIMALS) % 360.0


def _digits(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.{DIGITS}g}")
