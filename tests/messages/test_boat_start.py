"""Which start of the board is the newer one: what its greetings say, and else the number of the start."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from common.boat_start import BoatStart, StartOrder, boots_named
from tests.strategies import frame_of


def start(boot_id: str, start_no: int = 1) -> BoatStart:
    return BoatStart("c" + boot_id, boot_id, start_no)


def test_without_a_greeting_the_number_decides() -> None:
    order = StartOrder()
    assert order.is_before(start("a", 3), start("b", 4))
    assert not order.is_before(start("b", 4), start("a", 3))
    assert not order.is_before(start("b", 4), start("a", 4)), "without a start counter the other one is a new one"


def test_a_greeting_counts_more_than_a_number_that_went_back() -> None:
    order = StartOrder()
    order.greeted(["a", "b"])
    assert order.is_before(start("a", 12), start("b", 1))
    assert not order.is_before(start("b", 1), start("a", 12))


def test_what_a_later_greeting_does_not_name_any_more_is_older() -> None:
    order = StartOrder()
    order.greeted(["a", "b"])
    order.greeted(["c"])
    assert order.sorted([start("c", 1), start("b", 2), start("a", 3)]) == [start("a", 3), start("b", 2), start("c", 1)]


def test_a_card_of_an_older_backup_forgets_starts_that_stay_in_their_place() -> None:
    order = StartOrder()
    order.greeted(["a", "b", "c", "d"])
    order.greeted(["a", "b", "e"])
    assert [start.boot_id for start in order.sorted(map(start, "edcba"))] == ["a", "b", "c", "d", "e"]
    order.greeted(["a", "e", "f"])
    assert [start.boot_id for start in order.sorted(map(start, "fedcba"))] == ["a", "b", "c", "d", "e", "f"]


def test_a_start_that_no_greeting_named_has_the_place_of_its_number() -> None:
    order = StartOrder()
    order.greeted(["a", "b"])
    given = [start("x", 3), start("b", 2), start("y", 13), start("a", 12), start("z", 3)]
    assert [start.boot_id for start in order.sorted(given)] == ["x", "z", "a", "b", "y"]


@given(st.lists(st.lists(st.sampled_from("abcdefgh"), unique=True), max_size=6))
def test_the_last_greeting_holds_and_the_one_that_runs_is_the_newest(greetings: list[list[str]]) -> None:
    order = StartOrder()
    for named in greetings:
        order.greeted(named)
    for named in filter(None, greetings[-1:]):
        assert all(order.is_before(start(older, 9), start(newer, 1)) for older, newer in pairwise(named))
        known = {boot_id for each in greetings for boot_id in each} - {named[-1]}
        assert all(order.is_before(start(boot_id, 9), start(named[-1], 1)) for boot_id in known)


def test_runs_of_a_greeting_of_any_form() -> None:
    assert boots_named([["a", 1, 0, 9], ["b", 2, 0, 3]]) == ("a", "b")
    assert boots_named([5, [], [3, 1], None, ["a"]]) == ("a",)
    assert boots_named(5) == boots_named(None) == ()


def test_a_merged_frame_covers_its_numbers() -> None:
    assert list(frame_of(seq=9, first_seq=7).seqs) == [7, 8, 9]
    assert frame_of(seq=9).first == 9
    assert list(frame_of(seq=9).seqs) == [9]
