"""The table of events: every text can be filled, every event can travel."""

from string import Formatter

import pytest

from common.codec import decode_frame, encode_frame
from common.event_kinds import EVENTS
from common.events import event
from common.messages import LEVELS
from tests.strategies import frame_of


@pytest.mark.parametrize("code", EVENTS)
def test_an_event_of_the_table_fills_its_text_and_travels(code: str) -> None:
    kind = EVENTS[code]
    names = {name for _, name, _, _ in Formatter().parse(kind.text) if name is not None}
    assert all(name.isidentifier() for name in names)
    made = event(code, 1_000_000_000, "gps1", **{name: f"<{name}>" for name in names})
    assert all(f"<{name}>" in made.text for name in names)
    assert "{" not in made.text
    assert decode_frame(encode_frame(frame_of(made))).events == (made,)


@pytest.mark.parametrize("code", EVENTS)
def test_an_event_has_a_level_and_a_cure(code: str) -> None:
    assert EVENTS[code].level in LEVELS
    assert EVENTS[code].cure
    assert code == code.lower()


def test_evidence_the_text_does_not_name_travels_along_and_a_missing_one_is_our_bug() -> None:
    assert event("link-restored", 0, "link", age_s=2.0, extra=1).evidence == {"age_s": 2.0, "extra": 1}
    with pytest.raises(KeyError):
        event("link-restored", 0, "link")


def test_an_endless_reason_is_cut_to_what_a_frame_may_carry() -> None:
    made = event("port-lost", 0, "gps1", port="p", reason="x" * 2000)
    assert len(made.text) == 512
