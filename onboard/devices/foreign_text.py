"""Text protocol detection: lines that no driver claims, by name: sentences that are not read, and other formats.

A sentence of NMEA 0183 has its name in its address, its checksum says that it came whole. Other formats are known by
the form of a line.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from common.visible_lines import is_text
from onboard.devices.nmea_sentence import address, check_sentence, sentence_of

_GATEWAY: Final = "set the gateway to NMEA 0183 output"
_AS_NMEA: Final = "let the receiver send NMEA"

_MAKERS: Final = {
    "PUBX": "u-blox", "PTNL": "Trimble", "PASH": "Ashtech", "PFEC": "Furuno", "PSAT": "Hemisphere", "PGRM": "Garmin",
    "PSRF": "SiRF", "PMTK": "MediaTek", "PAIR": "Airoha", "PQTM": "Quectel", "PSTI": "SkyTraq", "PSTM": "ST",
    "PSSN": "Septentrio", "PHTR": "iXblue", "PIXS": "iXblue", "PRDI": "Teledyne", "PSXN": "Kongsberg",
    "PTNT": "Honeywell", "PRCT": "Raymarine", "PSIM": "Kongsberg Seatex", "PNOR": "Nortek", "PSBG": "SBG",
    "PXSE": "Xsens", "PLSR": "LORD", "PCDI": "NMEA 2000 as SeaSmart", "PDGY": "NMEA 2000 of an iKonvert",
    "PARM": "Airmar", "PAMT": "Airmar", "PMGN": "Magellan", "PJRC": "JRC", "PKWD": "Kenwood", "PSMD": "Simrad",
    "PUNV": "Unicore", "PYDG": "Yacht Devices", "PSTO": "Seatalk",
}  # fmt: skip
"""First four letters of a proprietary sentence -> who makes it."""

_FORMS: Final[tuple[tuple[str, re.Pattern[bytes], str], ...]] = (
    ("NMEA 2000 raw (Yacht Devices RAW)",
     re.compile(rb"\d\d:\d\d:\d\d\.\d+ [RT] [0-9A-Fa-f]{8}( [0-9A-Fa-f]{2})+"), _GATEWAY),
    ("NMEA 2000 raw (Actisense N2K ASCII)", re.compile(rb"A\d{6}\.\d{3} [0-9A-F]{5} [0-9A-F]{5} [0-9A-F]+"), _GATEWAY),
    ("NMEA 2000 raw (canboat)", re.compile(rb"\d{4}-\d\d-\d\d[-T ][\d:.]+Z?,\d+,\d+,\d+,\d+,\d+(,[0-9A-Fa-f]{2})+"),
     _GATEWAY),
    ("NMEA 2000 raw (iKonvert)", re.compile(rb"[!$]PDGY,.*"), _GATEWAY),
    ("CAN bus frames (candump)",
     re.compile(rb"(\(\d+\.\d+\) +)?v?s?l?can\d +[0-9A-F]{3,8}(#.*| +\[\d\].*)", re.IGNORECASE), _GATEWAY),
    ("CAN bus frames (SLCAN)", re.compile(rb"T[0-9A-Fa-f]{8}\d([0-9A-Fa-f]{2})*|t[0-9A-Fa-f]{3}\d([0-9A-Fa-f]{2})*"),
     _GATEWAY),
    ("Unicore or NovAtel ASCII", re.compile(rb"[#%][A-Z][A-Z0-9_]+,.*;.*"), _AS_NMEA),
    ("NovAtel abbreviated ASCII", re.compile(rb"<[A-Z][A-Z0-9_]{3,} .*|< {4,}.*"), _AS_NMEA),
    ("text of a Razor AHRS", re.compile(rb"[#!](YPR|ANG|A-|M-|G-|A:|AMG).*"), ""),
    ("JSON", re.compile(rb"\{.*\}|\[.*\]"), "its source is a program: connect the device itself"),
    ("answers of a modem",
     re.compile(rb"(AT[+&^%A-Z0-9].*|OK|ERROR|RING|NO CARRIER|\+[A-Z]{3,}: .*|\^[A-Z]{3,}:.*)"),
     "take the modem's port that sends NMEA, and keep ModemManager away from it"),
    ("the console of a computer",
     re.compile(rb".*\b(login|Password|Debian GNU/Linux|U-Boot|Starting kernel|BusyBox)\b.*|\[ *\d+\.\d{6}\] .*"),
     "turn that console off, or take another port"),
    ("Garmin text", re.compile(rb"@\d{12}[NS_].*"), "set the receiver to NMEA 0183"),
    ("sentences that lost their `$`", re.compile(rb"(G[PNLABQ]|HC|HE|II|AI|RA)[A-Z]{3},.*\*[0-9A-Fa-f]{2}"), ""),
    ("columns of numbers", re.compile(rb"[-+0-9.eE]+[,;\t ]+(?:[-+0-9.eE]+[,;\t ]+)*[-+0-9.eE]*"), ""),
)  # fmt: skip
"""Name, form of a line, what to do ("" = nothing but another device helps)."""


@dataclass(frozen=True, slots=True)
class TextSeen:
    """What lines were, those that were sound."""

    sentences: Counter[str]
    """Number of sentences with a right checksum, by `name_of`."""
    unchecked: Counter[str]
    """Number of sentences without a whole checksum, by name."""
    formats: Counter[str]
    """Number of other lines, by format; "text" = printable, of no form that is known."""
    damaged: int
    """Number of lines that are no text, or whose checksum is wrong."""
    example: bytes
    """The last line of other text."""


def text_seen(lines: Iterable[bytes]) -> TextSeen:
    """Sort lines by what they are."""
    sentences, unchecked, formats = Counter[str](), Counter[str](), Counter[str]()
    damaged, example = 0, b""
    for line in lines:
        data = line.strip()
        if not data:
            continue
        found = check_sentence(data)
        if not isinstance(found, str):
            sentences[name_of(data)] += 1
        elif found == "no-checksum" and (name := name_of(data)):
            unchecked[name] += 1
        elif found in ("checksum", "run-together", "too-long") or not is_text(data):
            damaged += 1
        else:
            formats[format_of(data)] += 1
            example = data
    return TextSeen(sentences, unchecked, formats, damaged, example)


def name_of(data: bytes) -> str:
    """Name of a sentence: `THS`, `PASHR`, `PUBX,00`; "" where it has none. The checksum is not looked at.

    A maker's own sentence whose address is the maker's code alone has its kind in the first field.
    """
    found = address(data)
    if found is not None:
        talker, formatter = found
        return f"VN{formatter}" if talker == "VN" else formatter
    match = _OWN.match(sentence_of(data))
    if match is None:
        return ""
    code, kind = match[1].decode("ascii"), (match[2] or b"").decode("ascii")
    return f"{code},{kind}" if kind and (len(code) == 4 or kind.isalpha()) else code


_OWN: Final = re.compile(rb"[$!]([A-Z][A-Z0-9]{2,9})(?:,([A-Za-z0-9]{1,8})(?=[,*]))?(?=[,*])")


def maker_of(name: str) -> str:
    """Who makes a proprietary sentence; "" = not known."""
    if name.startswith("VN"):
        return "VectorNav"
    return _MAKERS.get(name[:4], "") if name.startswith("P") and len(name) > 3 else ""


def format_of(data: bytes) -> str:
    """Name of the format that a printable line has; "text" where it is of no form that is known."""
    return next((name for name, form, _ in _FORMS if form.fullmatch(data)), "text")


def cure_of(name: str) -> str:
    """What to do when lines of this format come; "" = no setting of the device helps."""
    return next((cure for known, _, cure in _FORMS if known == name), "")
