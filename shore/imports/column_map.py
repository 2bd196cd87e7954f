"""Column mapping of a table, as an import reads it: the parts must fit together, and all of them may be left out."""

from pathlib import Path

from common.errors import WayfixError
from common.settings import read_toml
from common.simulation.column_map import IMPORT, ColumnMap, TimeColumn
from shore.imports.line_counts import Rejected
from shore.imports.time_cells import has_date
from shore.imports.values import utc_ns_of


def read_column_map(path: Path) -> ColumnMap:
    """Read and check it; raises WayfixError."""
    mapping = read_toml(path, ColumnMap, IMPORT)
    _check(mapping, str(path))
    return mapping


def _check(mapping: ColumnMap, file: str) -> None:
    fix, heading, imu, time = mapping.fix, mapping.heading, mapping.imu, mapping.time
    if fix is None and heading is None and imu is None:
        raise WayfixError("maps nothing", file, "add [fix], [heading] or [imu]")
    if fix is not None:
        plane = (fix.north, fix.east, fix.origin_lat_deg, fix.origin_lon_deg)
        ways = (fix.lat is not None, fix.place is not None, all(part is not None for part in plane))
        if fix.packed and any(scale not in (None, 1.0, -1.0) for scale in (fix.scale, fix.lon_scale)):
            raise WayfixError("[fix] is packed and has a scale", file, "leave one of packed and scale out")
        if (fix.lat_more or fix.lon_more) and (fix.lat is None or len(fix.lat_more) != len(fix.lon_more)):
            cure = "give as many columns in lat_more as in lon_more, behind lat and lon"
            raise WayfixError("[fix] has minutes for one of latitude and longitude", file, cure)
        if (fix.lat is None) != (fix.lon is None) or sum(ways) != 1:
            cure = "give lat and lon, or place, or north, east, origin_lat_deg and origin_lon_deg"
            raise WayfixError("[fix] is no position", file, cure)
    if heading is not None and ((heading.column is None) == (len(heading.quaternion) != 4)):
        raise WayfixError("[heading] is no direction", file, "give column, or the four columns of quaternion")
    if imu is not None and (imu.accel_fwd is None) != (imu.accel_stb is None):
        raise WayfixError("[imu] has one acceleration", file, "give accel_fwd and accel_stb, or neither")
    _check_time(time, file)
    try:
        utc_ns_of(time.zero_utc, "zero_utc")
    except Rejected as reason:
        raise WayfixError(f"[time] {reason}", file, 'write zero_utc = "2026-11-14T12:00:00Z"') from reason


def _check_time(time: TimeColumn, file: str) -> None:
    is_text, is_number = time.format is not None, time.format is None and not time.is_days
    if is_number and (time.more or time.utc):
        raise WayfixError("[time] says how text is read, but not its format", file, "add format, or excel = true")
    if (time.utc or time.gps) and not has_date(time.format):
        raise WayfixError("[time] is UTC without a day", file, "leave utc out, or add the column of the date to more")
    if is_text and time.is_days:
        cure = "leave one of format and excel (or day_of_1970) out"
        raise WayfixError("[time] is text and a day of Excel at once", file, cure)
    if time.excel and time.day_of_1970 is not None:
        raise WayfixError("[time] counts days in two ways", file, "leave one of excel and day_of_1970 out")
    if not is_number and (time.nanoseconds or time.unix or time.zero_utc or time.week):
        cure = "leave format and excel, or nanoseconds, unix, zero_utc and week out"
        raise WayfixError("[time] is text and a number at once", file, cure)
    if time.unix + (time.zero_utc is not None) + (time.gps and is_number) > 1:
        cure = "leave all but one of unix, zero_utc and gps out"
        raise WayfixError("[time] counts from two moments (1970, zero_utc, 1980)", file, cure)
    if time.week is not None and not time.gps:
        raise WayfixError("[time] has a week, which only GPS time has", file, "add gps = true")
