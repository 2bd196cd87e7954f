"""Antimeridian cutting: lines that cross the 180th meridian are cut there, as RFC 7946 (3.1.9) wants them."""

from typing import Final

HALF_TURN_DEG: Final = 180.0
Place = tuple[float, float]
"""A place of the track: latitude and longitude, deg."""


def crossing(before: Place, after: Place) -> tuple[Place, Place] | None:
    """The ends of the two parts on the meridian, when the short way between two places crosses it."""
    west_east = after[1] - before[1]
    if abs(west_east) <= HALF_TURN_DEG:
        return None
    side = HALF_TURN_DEG if before[1] > 0.0 else -HALF_TURN_DEG
    step_deg = west_east - 2.0 * HALF_TURN_DEG if west_east > 0.0 else west_east + 2.0 * HALF_TURN_DEG
    share = (side - before[1]) / step_deg if step_deg else 0.0
    lat_deg = before[0] + share * (after[0] - before[0])
    return (lat_deg, side), (lat_deg, -side)
