"""Latitude and longitude of a table (format inference): degrees, ddmm.mmmm, 1e-7 deg, parts in columns of their own."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

from common.errors import WayfixError
from common.simulation.column_map import FixColumns
from shore.imports.cells import angle_in, is_nothing, number_and_unit
from shore.imports.guess_names import candidates, plain
from shore.imports.line_counts import Rejected
from shore.imports.place_columns import PlaceColumns
from shore.imports.proposal import Proposal
from shore.imports.table_file import TableFile

_LEAST_SHARE: Final = 0.8
"""Share of a column's cells that must be of the kind its name says."""
_DECIMALS: Final = 4
"""So many decimals a place has, where no name tells it."""
_WHOLE_DEGREES: Final = 1_000_000
"""Whole numbers from here on are 1e-7 deg (MAVLink)."""
_MOST_RAD: Final = (1.5708, 3.1416)
_WEST: Final = re.compile(r"(^|[\s_(\[])(w|west)[)\]]?$", re.IGNORECASE)
_SOUTH: Final = re.compile(r"(^|[\s_(\[])(s|south)[)\]]?$", re.IGNORECASE)


def place_of(proposal: Proposal, file: TableFile, used: set[str]) -> dict[str, Any]:
    """The keys of a place in `[fix]`; none = there is no place. Raises WayfixError for places in whole degrees."""
    columns = file.table.columns
    lat, lon = (_angles(file, candidates(columns, role), used, axis) for role, axis in (("lat", "NS"), ("lon", "EW")))
    if "table" in proposal.tables:
        lat, lon = _pair(file, used)
    elif lat is None and lon is None:
        lat, lon = _of_map(file, used)
    if lat is None or lon is None:
        place = _first_place(file, candidates(columns, "place"))
        used |= set() if place is None else {place}
        return {} if place is None else {"place": place}
    fix: dict[str, Any] = {"lat": lat, "lon": lon}
    fix |= _finer(file, used)
    if "lat_more" not in fix:
        lats, lons = values_of(file, lat), values_of(file, lon)
        if lats and lons and 90.0 < max(map(abs, lats)) <= 180.0 and max(map(abs, lons)) <= 90.0:
            fix = {"lat": lon, "lon": lat}
            proposal.comments["fix", "lat"] = f"{lat!r} is beyond 90: the names are swapped?"
        fix |= _unit_of(proposal, file, fix, used)
    else:
        fix |= _letters(file, fix, used)
    used |= {lat, lon, *fix.get("lat_more", ()), *fix.get("lon_more", ())}
    return fix


def _unit_of(proposal: Proposal, file: TableFile, fix: dict[str, Any], used: set[str]) -> dict[str, Any]:
    """Scale and letters of a place of one column each."""
    lat, lon = fix["lat"], fix["lon"]
    lats, lons = values_of(file, lat, is_bare=True), values_of(file, lon, is_bare=True)
    if lats and all(abs(value) >= _WHOLE_DEGREES and value == int(value) for value in lats):
        if file.unit(lat, "angle") is not None:
            return {}
        if {plain(lat), plain(lon)} == {"position lat", "position long"}:
            return {"scale": 180.0 / 2**31}
        if max(map(abs, lats)) <= 9e7 and max(map(abs, lons), default=0.0) <= 1.8e8:
            proposal.questions["fix"] = "in which unit are the places?", ("scale = 1e-7", "scale = 1e-6")
            return {}
        return {"scale": 1e-7}
    if lats and all(_is_coarse(value) for value in (*lats, *lons)) and len(lats) > 2:
        what = f"has places in whole degrees or hundredths ({file.sample[0][lat]}, {file.sample[0][lon]})"
        cure = "name the columns of the minutes in a mapping (lat_more, lon_more), or export all digits"
        raise WayfixError(what, str(proposal.tables["boat"]["id"]), cure)
    found = _letters(file, fix, used)
    if found.get("packed"):
        proposal.comments["fix", "packed"] = "ddmm.mmmm? For minutes alone: scale = 0.01666667 instead"
    elif _is_in_radians(file, fix):
        proposal.questions["fix"] = "are these places in degrees or in radians?", ("scale = 1.0", "scale = 57.29578")
    if "north_south" not in found and _SOUTH.search(lat):
        proposal.above.append(
            f"Look at lat: the name of {lat!r} says south; scale = -1.0 and lon_scale = 1.0 mirror it"
        )
    if "east_west" not in found and _WEST.search(lon) and all(value >= 0.0 for value in lons):
        found["lon_scale"] = -1.0
        proposal.comments["fix", "lon_scale"] = "+ is west, by its name"
    return found


def _is_in_radians(file: TableFile, fix: dict[str, Any]) -> bool:
    """True when the places may be radians, and no name says degrees."""
    if any(file.unit(fix[key], "angle") is not None for key in ("lat", "lon")):
        return False
    if any("deg" in plain(fix[key]) for key in ("lat", "lon")):
        return False
    columns = zip(("lat", "lon"), _MOST_RAD, strict=True)
    return all(
        (values := values_of(file, fix[key])) and max(map(abs, values)) < most and len(values) > 2
        for key, most in columns
    )


def _is_coarse(degrees: float) -> bool:
    return abs(degrees * 100.0 - round(degrees * 100.0)) < 1e-6


def _finer(file: TableFile, used: set[str]) -> dict[str, Any]:
    """Columns of minutes and seconds beside those of whole degrees."""
    columns, found = file.table.columns, {}
    for axis in ("lat", "lon"):
        minutes, seconds = (
            next(
                (
                    name
                    for name in candidates(columns, f"{axis}_{part}")
                    if name not in used and _are_values(file, name)
                ),
                None,
            )
            for part in ("min", "sec")
        )
        if minutes is not None:
            found[f"{axis}_more"] = (minutes,) if seconds is None else (minutes, seconds)
    return found if len(found) == 2 else {}


def _of_map(file: TableFile, used: set[str]) -> tuple[str | None, str | None]:
    """Columns X and Y of a map in degrees: longitude and latitude."""
    x, y = (first(file, candidates(file.table.columns, role), used) for role in ("map_x", "map_y"))
    if x is None or y is None:
        return None, None
    texts = [row[name] for name in (x, y) for row in file.sample[:20]]
    are_degrees = max(map(abs, values_of(file, y))) <= 90.0 and max(map(abs, values_of(file, x))) <= 180.0
    return (y, x) if are_degrees and all(_has_decimals(text) for text in texts) else (None, None)


def _pair(file: TableFile, used: set[str]) -> tuple[str | None, str | None]:
    """The first two columns side by side, without names, that may be latitude and longitude."""
    for lat, lon in pairwise(name for name in file.table.columns if name not in used):
        texts = [(row[lat], row[lon]) for row in file.sample]
        values = values_of(file, lat), values_of(file, lon)
        if (
            all(_has_decimals(each) for pair in texts[:20] for each in pair)
            and all(map(len, values))
            and max(map(abs, values[0])) <= 90.0
        ):
            return lat, lon
    return None, None


def _has_decimals(text: str) -> bool:
    return len(text.replace(",", ".").partition(".")[2]) >= _DECIMALS


def _letters(file: TableFile, fix: dict[str, Any], used: set[str]) -> dict[str, Any]:
    """Columns of the hemisphere, and whether the places are ddmm.mmmm."""
    places = PlaceColumns(FixColumns(**fix), file.table.decimal, file.sample)
    found = {key: column for key, column in zip(("north_south", "east_west"), places.letters, strict=True) if column}
    used |= set(found.values())
    return {**found, **({"packed": True} if places.is_packed else {})}


def _angles(file: TableFile, columns: Sequence[str], used: set[str], axis: str) -> str | None:
    """The first column that holds angles, and is not used yet."""
    for column in columns:
        texts = [row[column] for row in file.sample if not is_nothing(row[column])]
        if column not in used and texts:
            good = sum(_is_angle(text, axis, file.table.decimal) for text in texts)
            if good >= _LEAST_SHARE * len(texts):
                return column
    return None


def _is_angle(text: str, axis: str, decimal: str) -> bool:
    try:
        angle_in(text, axis, decimal)
    except Rejected:
        return False
    return True


def first(file: TableFile, columns: Sequence[str], used: set[str]) -> str | None:
    """The first column that holds numbers (or angles), and is not used yet."""
    return next((name for name in columns if name not in used and _are_values(file, name)), None)


def _first_place(file: TableFile, columns: Sequence[str]) -> str | None:
    for column in columns:
        places = PlaceColumns(FixColumns(place=column), file.table.decimal, file.sample)
        try:
            if any(places.read(row) is not None for row in file.sample[:20]):
                return column
        except Rejected:
            continue
    return None


def _are_values(file: TableFile, column: str) -> bool:
    texts = [row[column] for row in file.sample if not is_nothing(row[column])]
    good = sum(any(map(str.isdigit, text)) and len(text) < 24 and ":" not in text for text in texts)
    return bool(texts) and good >= _LEAST_SHARE * len(texts)


def values_of(file: TableFile, column: str, *, is_bare: bool = False) -> list[float]:
    """The numbers of a column; is_bare: only those with nothing behind them."""
    found = []
    for row in file.sample:
        try:
            value, unit = number_and_unit(row[column], file.table.decimal)
        except Rejected:
            continue
        if not is_bare or not unit:
            found.append(value)
    return found
