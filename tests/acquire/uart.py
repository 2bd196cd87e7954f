"""A serial line between two speeds: the bytes that a receiver at one baud rate makes of a sender at another."""


def heard_at(data: bytes, sent_baud: int, read_baud: int) -> bytes:
    """Read a burst at another speed, 8N1: a byte begins with a falling edge, each of its bits is read in its middle.

    What comes after a stop bit that is none is taken as the receiver's hardware does: it waits for the line to rise.
    """
    bits = [1]
    for byte in data:
        bits += [0, *((byte >> place) & 1 for place in range(8)), 1]
    bits += [1] * 400
    width = sent_baud / read_baud
    heard, at = bytearray(), 0.0
    while True:
        try:
            start = bits.index(0, int(at)) if bits[int(at)] else int(at)
            at = max(at, float(start))
            taken = [bits[int(at + width * (place + 0.5))] for place in range(10)]
            if taken[0] == 0:
                heard.append(sum(bit << place for place, bit in enumerate(taken[1:9])))
            at += width * 9.5
            at = at if taken[9] else float(bits.index(1, int(at)))
        except (ValueError, IndexError):
            return bytes(heard)
