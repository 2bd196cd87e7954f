"""Device encoder (sensor simulation): one reading becomes the bytes that a device of some model prints for it.

A model of the registry is a driver and an encoder, side by side. An encoder rounds as its device does, and ends every
line. It invents nothing that a driver reads: a value that is `None` is an empty field, or a group that is switched off.
It is as pure as a driver: the time is an argument.

The readings are imported for type checkers only: a daemon, which never encodes, starts without them.
"""

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, TypeVar

from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.nmea_sentence import checksum

if TYPE_CHECKING:
    from common.simulation import readings

    Reading_contra = TypeVar("Reading_contra", bound=readings.Reading, contravariant=True)
else:
    Reading_contra = TypeVar("Reading_contra", contravariant=True)

LINE_END: Final = b"\r\n"


class Surroundings(NamedTuple):
    """What a device knows of the world beside its readings."""

    utc_start_ns: int
    """UTC of t = 0, ns since 1970, whole milliseconds."""
    variation_deg: float = 0.0
    """Magnetic variation where the boat sails, deg, east +: magnetic = true - variation."""

    def utc_ms(self, t_s: float) -> int:
        """UTC at `t_s`, ms since 1970."""
        return round((self.utc_start_ns + t_s * NS_PER_S) / NS_PER_MS)


class Encoder(Protocol[Reading_contra]):
    """One sensor's encoder, made from its table and its surroundings. One object for each `[[sensor]]` that speaks."""

    def encode(self, t_s: float, reading: Reading_contra) -> bytes:
        """All that the device prints for a reading valid `t_s` seconds after the start, line ends included.

        Call it in order of time, with the readings of the sensor's role: some devices integrate.
        """
        ...


def sealed(body: str) -> bytes:
    """`body` between `$` and checksum (exclusive or of its bytes), line end included."""
    data = body.encode("ascii")
    return b"$%b*%02X\r\n" % (data, checksum(data))


def fixed(value: float | None, decimals: int) -> str:
    """`value` with so many decimals, no minus before a zero; empty for `None`."""
    return "" if value is None else f"{round(value, decimals) + 0.0:.{decimals}f}"


def day_and_clock(utc_ms: int) -> tuple[str, str]:
    """`ddmmyy` and `hhmmss.sss`."""
    utc = datetime.fromtimestamp(utc_ms // 1000, tz=UTC)
    return f"{utc:%d%m%y}", f"{utc:%H%M%S}.{utc_ms % 1000:03d}"


def place(lat_deg: float, lon_deg: float, decimals: int) -> str:
    """`ddmm.mmmm,N,dddmm.mmmm,E`; decimals: those of the minutes."""
    return f"{_angle(lat_deg, 2, decimals, 'NS')},{_angle(lon_deg, 3, decimals, 'EW')}"


def _angle(angle_deg: float, degree_digits: int, decimals: int, letters: str) -> str:
    """Degrees, minutes and the letter. Rounding comes before the split, so minutes never read 60."""
    units = 10**decimals
    total = round(abs(angle_deg) * 60 * units)
    degrees, rest = divmod(total, 60 * units)
    whole, fraction = divmod(rest, units)
    return f"{degrees:0{degree_digits}d}{whole:02d}.{fraction:0{decimals}d},{letters[angle_deg < 0 and total > 0]}"
