"""AIS messages as sentences (AIVDM, AIVDO): position reports of class A and B, static data; 6-bit payload armouring.

Layouts of ITU-R M.1371-5, Annex 8: message 1 (Table 46), message 5 (Table 52), message 18 (Table 67). Armouring and
sentence of IEC 61162-1. Only what a receiver near the boat would print; decoding is done ashore.
"""

from dataclasses import dataclass
from typing import Final

from common.units import M_S_PER_KN

_SIX_BIT: Final = "@ABCDEFGHIJKLMNOPQRSTUVWXYZ[\\]^_ !\"#$%&'()*+,-./0123456789:;<=>?"
_LONGEST_PAYLOAD: Final = 60
"""Characters of payload in one sentence, so that it stays within 82 characters."""
_NO_HEADING: Final = 511
_NO_SECOND: Final = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Where a ship is at one time; what it sends in a position report."""

    mmsi: int
    lat_deg: float
    lon_deg: float
    sog_m_s: float
    cog_true_deg: float
    heading_true_deg: float | None = None


class _Bits:
    """Fields one after the other, most significant bit first."""

    def __init__(self) -> None:
        self.text = ""

    def number(self, value: int, width: int) -> "_Bits":
        """An unsigned number, or a signed one as two's complement."""
        self.text += format(value & ((1 << width) - 1), f"0{width}b")
        return self

    def letters(self, text: str, count: int) -> "_Bits":
        """Six-bit ASCII, filled up with `@`."""
        for letter in text.upper()[:count].ljust(count, "@"):
            self.number(_SIX_BIT.index(letter), 6)
        return self


def position_a(report: Report, talker: str = "AIVDM", channel: str = "A") -> tuple[str, ...]:
    """Message 1, under way using engine, class A. Talker `AIVDO` = of the own ship."""
    bits = _Bits().number(1, 6).number(0, 2).number(report.mmsi, 30).number(0, 4).number(-128, 8)
    _movement(bits, report).number(_NO_SECOND, 6).number(0, 2 + 3 + 1 + 19)
    return _sentences(bits.text, talker, channel)


def position_b(report: Report, talker: str = "AIVDM", channel: str = "B") -> tuple[str, ...]:
    """Message 18, class B with carrier sense."""
    bits = _Bits().number(18, 6).number(0, 2).number(report.mmsi, 30).number(0, 8)
    _movement(bits, report).number(_NO_SECOND, 6).number(0, 2).number(0b101100, 6).number(0, 1 + 20)
    return _sentences(bits.text, talker, channel)


def static_a(mmsi: int, name: str, number: int) -> tuple[str, ...]:
    """Message 5 of a cargo ship of 90 by 14 m: two sentences that belong together by `number` (0 to 9)."""
    ship_type, length_m, beam_m = 70, 90, 14
    bits = _Bits().number(5, 6).number(0, 2).number(mmsi, 30).number(0, 2).number(0, 30)
    bits.letters("", 7).letters(name, 20).number(ship_type, 8)
    bow, port = length_m // 2, beam_m // 2
    bits.number(bow, 9).number(length_m - bow, 9).number(port, 6).number(beam_m - port, 6).number(1, 4)
    bits.number(0, 4 + 5).number(24, 5).number(60, 6).number(0, 8).letters("", 20).number(0, 2)
    return _sentences(bits.text, "AIVDM", "A", number)


def _movement(bits: _Bits, report: Report) -> _Bits:
    """Speed, accuracy, place, course and heading, which follow each other in messages 1 and 18 alike."""
    sog = min(1022, round(report.sog_m_s / M_S_PER_KN * 10.0))
    heading = report.heading_true_deg
    bits.number(sog, 10).number(1, 1)
    bits.number(round(report.lon_deg * 600_000.0), 28).number(round(report.lat_deg * 600_000.0), 27)
    bits.number(round(report.cog_true_deg * 10.0) % 3600, 12)
    return bits.number(_NO_HEADING if heading is None else round(heading) % 360, 9)


def _sentences(bits: str, talker: str, channel: str, number: int | None = None) -> tuple[str, ...]:
    fill = -len(bits) % 6
    values = [int((bits + "0" * fill)[at : at + 6], 2) for at in range(0, len(bits), 6)]
    payload = "".join(chr(value + 48 if value < 40 else value + 56) for value in values)
    parts = [payload[at : at + _LONGEST_PAYLOAD] for at in range(0, len(payload), _LONGEST_PAYLOAD)]
    together = "" if number is None else str(number)
    return tuple(
        _closed(f"{talker},{len(parts)},{k},{together},{channel},{part},{fill if k == len(parts) else 0}")
        for k, part in enumerate(parts, start=1)
    )


def _closed(body: str) -> str:
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"!{body}*{checksum:02X}"
