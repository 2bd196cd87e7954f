"""Column mapping of a table, as an import reads it: the parts must fit together, and all of them may be left out."""

from pathlib import Path

from common.errors import WayfixError
from common.settings import read_toml
from common.simulation.column_map import IMPORT, ColumnMap


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
        if ((fix.lat is None) != (fix.lon is None)) or ((fix.lat is None) != all(part is not None for part in plane)):
            cure = "give lat and lon, or north, east, origin_lat_deg and origin_lon_deg"
            raise WayfixError("[fix] is no position", file, cure)
    if heading is not None and ((heading.column is None) == (len(heading.quaternion) != 4)):
        raise WayfixError("[heading] is no direction", file, "give column, or the four columns of quaternion")
    if imu is not None and (imu.accel_fwd is None) != (imu.accel_stb is None):
        raise WayfixError("[imu] has one acceleration", file, "give accel_fwd and accel_stb, or neither")
    if time.format is None and (time.more or time.utc):
        raise WayfixError("[time] says how text is read, but not its format", file, "add format")
    if time.format is not None and (time.nanoseconds or time.unix):
        raise WayfixError("[time] is text and a number at once", file, "leave format, or nanoseconds and unix out")
