"""Frames of an older start of the board are known by their clock and number, whatever their order."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from common.boat_start import BoatStart
from tests.strategies import frame_of


def test_an_older_clock_is_before_a_newer_one_and_one_clock_is_never_before_itself() -> None:
    old, new = BoatStart("c1", 3), BoatStart("c2", 4)
    assert old.is_before(new)
    assert not new.is_before(old)
    assert not BoatStart("c1", 1).is_before(old), "a daemon that was restarted on one boot: its times are comparable"
    assert not BoatStart("c2", 4).is_before(BoatStart("c1", 4)), "without a start counter the other clock is a new one"


@given(st.lists(st.tuples(st.sampled_from(["c1", "c2"]), st.integers(0, 5)), min_size=1))
def test_the_newest_start_has_the_highest_number_that_came(starts: list[tuple[str, int]]) -> None:
    newest = BoatStart(*starts[0])
    taken = [newest.start_no]
    for clock_id, start_no in starts:
        frame = replace(frame_of(), clock_id=clock_id, start_no=start_no)
        if not BoatStart.of(frame).is_before(newest):
            newest = newest.followed_by(frame)
            taken.append(start_no)
            assert newest.clock_id == clock_id
    assert newest.start_no == max(taken)


def test_a_merged_frame_covers_its_numbers() -> None:
    assert list(frame_of(seq=9, first_seq=7).seqs) == [7, 8, 9]
    assert frame_of(seq=9).first == 9
    assert list(frame_of(seq=9).seqs) == [9]
