"""Ranges of sequence numbers against plain sets."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from common.seqset import SeqSet

RANGES = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 6)).map(lambda item: (item[0], item[0] + item[1])))


def plain(ranges: list[tuple[int, int]]) -> set[int]:
    return {seq for first, last in ranges for seq in range(first, last + 1)}


@given(RANGES)
def test_a_set_of_ranges_is_a_set(ranges: list[tuple[int, int]]) -> None:
    seqs, known = SeqSet(), set[int]()
    for first, last in ranges:
        span = set(range(first, last + 1))
        assert seqs.add(first, last) == (not span <= known)
        known |= span
    kept = list(seqs)
    assert plain(kept) == known
    assert len(seqs) == len(known)
    assert all(seq in seqs for seq in known)
    assert not any(seq in seqs for seq in set(range(80)) - known)
    assert all(before[1] + 1 < after[0] for before, after in pairwise(kept))


@given(RANGES, st.integers(0, 70), st.integers(-1, 70))
def test_gaps_are_what_is_not_in_it(ranges: list[tuple[int, int]], first: int, last: int) -> None:
    gaps = list(SeqSet(ranges).gaps(first, last))
    assert plain(gaps) == set(range(first, last + 1)) - plain(ranges)
    assert all(low <= high for low, high in gaps)
    assert all(before[1] < after[0] for before, after in pairwise(gaps))
