"""Protocol detection: frames of binary protocols that are not read here, by sync bytes, length and checksum.

A frame counts where its checksum is right. Where the checksum says little, or is not tested, another frame must follow
to the byte. A verdict needs `LEAST_FRAMES` of them: neither text nor noise makes that many.
Layouts are those of the makers' interface manuals.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from common.checks import (
    X25_STEPS,
    crc16,
    crc16_reflected,
    crc24q,
    crc32_from_zero,
    fletcher,
    sum8,
    xor8,
)

LEAST_FRAMES: Final = 3
"""Number of frames that are no accident; one less where the mark has more than one byte."""
PATIENCE: Final = 64
"""Number of places that look like a beginning and are none, after which a protocol is given up: looking is bounded."""
PATIENCE_OF_A_FRAME: Final = 4
"""Number of such places that each frame allows in addition."""
LONGEST_FRAME: Final = 2_100

GNSS: Final = "turn on its NMEA output"
NO_DRIVER: Final = "no driver reads it (docs/devices.md)"
GATEWAY: Final = "set the gateway to NMEA 0183 output"
CORRECTIONS: Final = "these are corrections, no positions: connect the receiver's NMEA output"
NO_TRACKER: Final = "it is no marine radar whose tracker sends TTM"
AUTOPILOT: Final = "set that port of the autopilot to NMEA output (ArduPilot: SERIALn_PROTOCOL = 20)"

Size = Callable[[bytes], int]
"""Bytes from a sync mark on -> length of the frame; 0 = it is none. IndexError = more bytes are needed to say."""
Check = Callable[[bytes], bool]
"""One whole frame -> whether its checksum is right."""


@dataclass(frozen=True, slots=True)
class Framing:
    """How frames of one protocol look."""

    name: str
    cure: str
    sync: bytes
    size: Size
    check: Check = lambda _: True
    is_chained: bool = False
    """The checksum says little or nothing: the next frame has to follow to the byte."""


@dataclass(frozen=True, slots=True)
class Frames:
    """What was found of one protocol."""

    framing: Framing
    count: int
    size: int
    """Number of bytes in frames."""


def frames_in(data: bytes) -> tuple[list[Frames], bytes]:
    """The protocols of which there are several frames, most bytes first, and what is left without their frames."""
    found = []
    for framing in FRAMINGS:
        spans = list(_spans(data, framing))
        if len(spans) >= LEAST_FRAMES - (len(framing.sync) > 1):
            found.append(Frames(framing, len(spans), sum(end - begin for begin, end in spans)))
            data = _without(data, spans)
    return sorted(found, key=lambda item: item.size, reverse=True), data


def _without(data: bytes, spans: list[tuple[int, int]]) -> bytes:
    begins = [0, *(end for _, end in spans)]
    ends = [*(begin for begin, _ in spans), len(data)]
    return b"".join(data[begin:end] for begin, end in zip(begins, ends, strict=True))


def _spans(data: bytes, framing: Framing) -> Iterator[tuple[int, int]]:
    """Begin and end of each frame that counts."""
    at, patience = data.find(framing.sync), PATIENCE
    while at >= 0 and patience > 0:
        end = _end(data, at, framing)
        patience += PATIENCE_OF_A_FRAME if end else -1
        if end:
            yield at, end
        at = data.find(framing.sync, end or at + 1)


def _end(data: bytes, at: int, framing: Framing) -> int:
    """End of the frame that begins there; 0 = there is none that counts."""
    head = data[at : at + LONGEST_FRAME]
    try:
        size = framing.size(head)
    except IndexError:
        return 0
    end = at + size
    if size <= len(framing.sync) or size > len(head) or not framing.check(head[:size]):
        return 0
    # What ends the data may have been followed by the next frame.
    is_followed = end == len(data) or data.startswith(framing.sync, end)
    return end if is_followed or not framing.is_chained else 0


def _fixed(size: int) -> Size:
    return lambda _: size


def _little(at: int, more: int) -> Size:
    """Length in two bytes, lowest first, without `more` bytes around it."""
    return lambda head: (head[at] | head[at + 1] << 8) + more


def _big(at: int, more: int) -> Size:
    return lambda head: (head[at] << 8 | head[at + 1]) + more


def _byte(at: int, more: int) -> Size:
    return lambda head: head[at] + more


def _check(
    rule: Callable[[bytes], int],
    begin: int,
    width: int = 1,
    *,
    big: bool = False,
    behind: bytes = b"",
    mask: int = -1,
) -> Check:
    """A checksum of `width` bytes over all from `begin` up to it, before the bytes `behind`."""

    def is_right(frame: bytes) -> bool:
        if not frame.endswith(behind):
            return False
        end = len(frame) - len(behind)
        kept = frame[end - width : end]
        number = int.from_bytes(kept, "big" if big else "little")
        return rule(frame[begin : end - width]) & mask & (1 << 8 * width) - 1 == number

    return is_right


def _fletcher_from(begin: int) -> Check:
    return _check(fletcher, begin, 2, big=True)


def _negative(data: bytes) -> int:
    return -sum(data) & 0xFF


def _xsens_size(head: bytes) -> int:
    return head[3] + 5 if head[3] < 0xFF else (head[4] << 8 | head[5]) + 7


def _mavlink_1(head: bytes) -> int:
    return head[1] + 8


def _mavlink_2(head: bytes) -> int:
    if head[2] > 1 or head[3]:
        return 0
    return head[1] + 12 + 13 * head[2]


def _mavlink_check(frame: bytes) -> bool:
    """The CRC ends with one byte that only the message's definition knows: any byte will do, so that it is 8 bits."""
    if frame[0] == 0xFD and frame[2]:
        frame = frame[:-13]  # the signature
    before = crc16_reflected(frame[1:-2], 0xFFFF)
    return (frame[-2] | frame[-1] << 8) ^ before >> 8 in X25_STEPS


def _rtcm_size(head: bytes) -> int:
    return 0 if head[1] & 0xFC else (head[1] << 8 | head[2]) + 6


def _witmotion_check(frame: bytes) -> bool:
    return 0x50 <= frame[1] <= 0x5F and sum8(frame[:-1]) == frame[-1]


def _escaped(head: bytes) -> int:
    """Length of a frame between DLE and DLE ETX; a DLE inside is sent twice."""
    at = 2
    while True:
        if head[at] == 0x10:
            if head[at + 1] == 0x03:
                return at + 2
            if head[at + 1] != 0x10:
                return 0
            at += 1
        at += 1


def _inside(frame: bytes) -> bytes:
    return frame[1:-2].replace(b"\x10\x10", b"\x10")


def _ngt_check(frame: bytes) -> bool:
    inside = _inside(frame)[1:]
    return len(inside) >= 3 and inside[1] == len(inside) - 3 and sum8(inside) == 0


def _garmin_check(frame: bytes) -> bool:
    inside = _inside(frame)
    return len(inside) >= 3 and inside[1] == len(inside) - 3 and sum8(inside) == 0


def _tsip_size(head: bytes) -> int:
    return 0 if head[1] in (0x02, 0x03, 0x10) else _escaped(head)


def _novatel_size(head: bytes) -> int:
    return head[3] + (head[8] | head[9] << 8) + 4


def _hipnuc_check(frame: bytes) -> bool:
    return crc16(frame[:4] + frame[6:]) == frame[4] | frame[5] << 8


def _um7_size(head: bytes) -> int:
    kind = head[3]
    words = (kind >> 2 & 0xF if kind & 0x40 else 1) if kind & 0x80 else 0
    return 7 + 4 * words


def _vectornav_size(head: bytes) -> int:
    """Distance to the next frame with the same header: which fields it has is in the header, their sizes are not."""
    return 0 if head[1] in (0, 0xFF) else head.find(head[:4], 4)


def _skytraq_check(frame: bytes) -> bool:
    return frame.endswith(b"\r\n") and xor8(frame[4:-3]) == frame[-3]


def _wheeltec_size(head: bytes) -> int:
    size = head[2] + 8
    return size if head[size - 1] == 0xFD else 0


FRAMINGS: Final[tuple[Framing, ...]] = (
    # Receivers.
    Framing("u-blox UBX", GNSS, b"\xb5\x62", _little(4, 8), _fletcher_from(2)),
    Framing("SiRF binary", GNSS, b"\xa0\xa2", _big(2, 8), _check(sum, 4, 2, big=True, behind=b"\xb0\xb3", mask=0x7FFF)),
    Framing("SkyTraq binary", GNSS, b"\xa0\xa1", _big(2, 7), _skytraq_check),
    Framing("Trimble GSOF", GNSS, b"\x02", _byte(3, 6), _check(sum8, 1, behind=b"\x03")),
    Framing("NovAtel binary", GNSS, b"\xaa\x44\x12", _novatel_size, _check(crc32_from_zero, 0, 4)),
    Framing("NovAtel binary (short)", GNSS, b"\xaa\x44\x13", _byte(3, 16), _check(crc32_from_zero, 0, 4)),
    Framing("Unicore binary", GNSS, b"\xaa\x44\xb5", _little(6, 28), _check(crc32_from_zero, 0, 4)),
    Framing("Hemisphere binary", GNSS, b"$BIN", _little(6, 12), _check(sum, 8, 2, behind=b"\r\n")),
    Framing("Allystar binary", GNSS, b"\xf1\xd9", _little(4, 8), _fletcher_from(2)),
    Framing("MediaTek binary", GNSS, b"\x04\x24", _little(2, 0), _check(xor8, 2, behind=b"\r\n")),
    Framing("Swift SBP", GNSS, b"\x55", _byte(5, 8), _check(crc16, 1, 2)),
    Framing("RTCM 3 corrections", CORRECTIONS, b"\xd3", _rtcm_size, _check(crc24q, 0, 3, big=True)),
    Framing("Garmin binary", GNSS, b"\x10", _escaped, _garmin_check),
    # Gateways.
    Framing("NMEA 2000 of an Actisense NGT-1", GATEWAY, b"\x10\x02", _escaped, _ngt_check),
    # Inertial units.
    Framing("WitMotion binary (0x55)", NO_DRIVER, b"\x55", _fixed(11), _witmotion_check),
    Framing("Xsens MT binary", NO_DRIVER, b"\xfa\xff", _xsens_size, lambda frame: sum8(frame[1:]) == 0),
    Framing("VectorNav binary", NO_DRIVER, b"\xfa", _vectornav_size, lambda frame: crc16(frame[1:]) == 0),
    Framing("MicroStrain MIP", NO_DRIVER, b"\x75\x65", _byte(3, 6), _fletcher_from(0)),
    Framing("BNO08x RVC binary", NO_DRIVER, b"\xaa\xaa", _fixed(19), _check(sum8, 2)),
    Framing("SBG sbgECom", NO_DRIVER, b"\xff\x5a", _little(4, 9), _check(crc16_reflected, 2, 2, behind=b"\x33")),
    Framing("Inertial Labs binary", NO_DRIVER, b"\xaa\x55", _little(4, 2), _check(sum, 2, 2)),
    Framing("HiPNUC binary", NO_DRIVER, b"\x5a\xa5", _little(2, 6), _hipnuc_check),
    Framing("Yesense binary", NO_DRIVER, b"\x59\x53", _byte(4, 7), _fletcher_from(2)),
    Framing("LP-Research binary", NO_DRIVER, b"\x3a", _little(5, 11), _check(sum, 1, 2, behind=b"\r\n")),
    Framing("UM7 binary", NO_DRIVER, b"snp", _um7_size, _check(sum, 0, 2, big=True)),
    Framing("ArduIMU binary", "load the sketch that prints text", b"DIYd", _byte(4, 8), _fletcher_from(4)),
    # Autopilots.
    Framing("MAVLink 2", AUTOPILOT, b"\xfd", _mavlink_2, _mavlink_check, is_chained=True),
    Framing("MAVLink 1", AUTOPILOT, b"\xfe", _mavlink_1, _mavlink_check, is_chained=True),
    Framing("MSP of a flight controller", AUTOPILOT, b"$M>", _byte(3, 6), _check(xor8, 3)),
    # Without a checksum that is tested.
    Framing("Septentrio SBF", GNSS, b"$@", _little(6, 0), is_chained=True),
    Framing("CASIC binary", GNSS, b"\xba\xce", _little(2, 10), is_chained=True),
    Framing("Trimble TSIP", GNSS, b"\x10", _tsip_size, is_chained=True),
    Framing("WitMotion binary (0x55 0x61)", NO_DRIVER, b"\x55\x61", _fixed(20), is_chained=True),
    Framing("Wheeltec N100 (FDILink)", NO_DRIVER, b"\xfc", _wheeltec_size, is_chained=True),
    Framing("KVH gyro binary", NO_DRIVER, b"\xfe\x81\xff\x55", _fixed(36), is_chained=True),
    Framing("mmWave radar binary", NO_TRACKER, b"\x02\x01\x04\x03\x06\x05\x08\x07", _little(12, 0), is_chained=True),
)
