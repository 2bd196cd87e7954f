"""Column mapping of a table, as an import reads it: the parts must fit together, and all of them may be left out."""

from pathlib import Path

from common.errors import WayfixError
from common.settings import read_toml
from common.simulation.column_map import IMPORT, ColumnMap
from shore.imports.cell_columns import has_date
from shore.imports.line_counts import Rejected
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
        if (fix.lat is None) != (fix.lon is None) or sum(ways) != 1:
            cure = "give lat and lon, or place, or north, east, origin_lat_deg and origin_lon_deg"
            raise WayfixError("[fix] is no position", file, cure)
    if heading is not None and ((heading.column is None) == (len(heading.quaternion) != 4)):
        raise WayfixError("[heading] is no direction", file, "give column, or the four columns of quaternion")
    if imu is not None and (imu.accel_fwd is None) != (imu.accel_stb is None):
        raise WayfixError("[imu] has one acceleration", file, "give accel_fwd and accel_stb, or neither")
    if time.format is None and not time.excel and (time.more or time.utc):
        raise WayfixError("[time] says how text is read, but not its format", file, "add format, or excel = true")
    if time.utc and not has_date(time.format):
        raise WayfixError("[time] is UTC without a day", file, "leave utc out, or add the column of the date to more")
    if time.format is not None and time.excel:
        raise WayfixError("[time] is text and a day of Excel at once", file, "leave one of format and excel out")
    if (time.format is not None or time.excel) and (time.nanoseconds or time.unix or time.zero_utc):
        cure = "leave format and excel, or nanoseconds, unix and zero_utc out"
        raise WayfixError("[time] is text and a number at once", file, cure)
    if time.unix and time.zero_utc is not None:
        raise WayfixError("[time] counts from 1970 and from zero_utc", file, "leave one of unix and zero_utc out")
    try:
        utc_ns_of(time.zero_utc, "zero_utc")
    except Rejected as reason:
        raise WayfixError(f"[time] {reason}", file, 'write zero_utc = "2026-11-14T12:00:00Z"') from reason
