"""Status report of a running daemon, for a terminal: a table of the sensors, and what else it says of itself."""

from collections.abc import Iterator, Mapping
from typing import Any

from common.command import flat, printable

_HEAD = ("sensor", "state", "rate", "age", "reason")


def status_lines(told: Mapping[str, Any]) -> Iterator[str]:
    """The answer to the request `status`, as lines for people."""
    sensors = told.get("sensors", {})
    delivering = sum(sensor["state"] == "delivering" for sensor in sensors.values())
    clients = told.get("clients", 0)
    yield (
        f"boat {told.get('boat_id')}, {delivering} of {len(sensors)} sensors deliver, "
        f"{clients} client{'' if clients == 1 else 's'}"
    )
    rows = [_HEAD, *(_row(name, sensor) for name, sensor in sensors.items())]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD) - 1)]
    for *cells, reason in rows:
        aligned = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        yield "  ".join((*aligned, reason)).rstrip()
    rest = {name: value for name, value in told.items() if name not in ("boat_id", "clients", "sensors")}
    for name, value in flat(rest):
        yield f"{name}: {'-' if value is None else value}"


def _row(name: str, sensor: Mapping[str, Any]) -> tuple[str, ...]:
    rate_hz, age_s = sensor.get("rate_hz"), sensor.get("age_s")
    return (
        name,
        str(sensor["state"]),
        "-" if not rate_hz else f"{rate_hz:.3g} Hz",
        "-" if age_s is None else f"{age_s:.1f} s",
        printable(str(sensor.get("reason") or "")),
    )
