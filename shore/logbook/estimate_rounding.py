"""Quantisation (rounding) of estimates for the log, far below their own sigma, with a digest of every bit."""

import math
import struct
from collections.abc import Iterator
from hashlib import blake2b
from typing import Any, Final

Record = dict[str, Any]

DIGITS: Final = 5
"""Significant digits that are kept of covariances, sigmas and what the channels report."""
STATE_SHARE: Final = 3
"""Decimals kept below the 1-sigma of a number of the state: it is rounded to a thousandth of that."""
PLACE_DECIMALS: Final = 9
"""Decimals of latitude and longitude (deg): the last one is 0.1 mm."""
ANGLE_DECIMALS: Final = 5
_NAN: Final = math.nan


def logged(record: Record) -> Record:
    """What is stored of `Estimate.as_record()`: the same fields, rounded, and `digest`.

    The 8-hour log of a small boat is half as large for it. A replay compares digests, so equality is still bit for bit.
    """
    variances = _diagonal(record["covariance"], len(record["state"]))
    return {
        **record,
        "state": [_below(value, variance) for value, variance in zip(record["state"], variances, strict=True)],
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


def digest_of(record: Record) -> str:
    """16 hex digits over every number and word of `Estimate.as_record()`; a stored record says its own."""
    if "digest" in record:
        return str(record["digest"])
    numbers = list(_numbers(record))
    words = [record["filter"], record["boot_id"], *record["names"], *record["waiting"], *record["channels"]]
    whole = (record["t_ns"], record["seq"], record["repairs"], record["aligned"])
    digest = blake2b(struct.pack(f"<{len(numbers)}d", *numbers), digest_size=8)
    digest.update(f"{whole} {words}".encode())
    return digest.hexdigest()


def _numbers(record: Record) -> Iterator[float]:
    yield from record["state"]
    yield from record["covariance"]
    for name in ("origin_lat_deg", "origin_lon_deg", "lat_deg", "lon_deg", "heading_true_deg", "sog_kn"):
        yield record[name]
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
