from common.boat_status import status_lines
from common.visible_lines import VisibleLines, is_text, shown, visible


def test_the_status_is_a_table_with_state_rate_age_and_reason() -> None:
    sensors = {
        "gps1": {"state": "delivering", "reason": None, "rate_hz": 1.0, "age_s": 0.4},
        "compass1": {"state": "silent", "reason": "THS comes, which is not read", "rate_hz": 0.0, "age_s": None},
    }
    told = {"boat_id": "b", "clients": 1, "next_seq": 7, "sensors": sensors, "spool": {"fault": None}}
    assert list(status_lines(told)) == [
        "boat b, 1 of 2 sensors deliver, 1 client",
        "sensor    state       rate  age    reason",
        "gps1      delivering  1 Hz  0.4 s",
        "compass1  silent      -     -      THS comes, which is not read",
        "next_seq: 7",
        "spool.fault: -",
    ]


def test_a_reason_cannot_steer_the_terminal() -> None:
    told = {"sensors": {"gps1": {"state": "silent", "reason": "\x1b[2J"}}}
    assert "\x1b" not in "".join(status_lines(told))


def test_lines_are_shown_as_they_end_and_control_characters_by_their_number() -> None:
    lines: list[str] = []
    printer = VisibleLines(lines.append)
    printer.feed(b"$HCHDM,1")
    assert lines == []
    printer.feed(b"23.4,M\r\n\x07ping pong\r")
    assert lines == ["$HCHDM,123.4,M", "\\x07ping pong"]
    printer.feed(b"no end")
    printer.feed(b"")
    assert lines[2:] == ["no end"]


def test_a_degree_sign_is_text() -> None:
    assert is_text(b"84.4\xb0 -1.2\xb0 0.8\xc2\xb0")
    assert not is_text(b"\xb0\xb0 84.4")


def test_what_is_no_text_is_shown_in_hexadecimal() -> None:
    assert visible(b"\xb5\x62\x01\x07") == "b5 62 01 07"
    assert len(shown(b"x" * 500)) == 76
