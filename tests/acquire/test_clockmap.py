import random

from common.messages import ClockPair
from common.units import NS_PER_MS, NS_PER_S
from onboard.clockmap import ClockMap

UTC0 = 1_750_000_000 * NS_PER_S


def pair(t_ns: int, utc_ns: int) -> ClockPair:
    return ClockPair(sensor="gps1", t_ns=t_ns, utc_ns=utc_ns, source="RMC")


def test_nothing_is_claimed_before_the_first_pair() -> None:
    assert ClockMap().at(5).utc_ns is None
    assert ClockMap().at(5).source == "none"


def test_late_arrivals_do_not_move_the_mapping() -> None:
    mapping, rng = ClockMap(), random.Random(1)
    for k in range(60):
        late_ns = rng.randrange(300) * NS_PER_MS if k != 17 else 0
        assert mapping.add(pair(k * NS_PER_S + late_ns, UTC0 + k * NS_PER_S)) is None
    assert mapping.at(10 * NS_PER_S).utc_ns == UTC0 + 10 * NS_PER_S


def started(mapping: ClockMap) -> ClockMap:
    for k in range(5):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S)) is None
    return mapping


def test_a_step_is_believed_at_its_third_pair_told_once_and_starts_a_new_epoch() -> None:
    mapping = started(ClockMap())
    told = [mapping.add(pair(k * NS_PER_S, UTC0 + (100 + k) * NS_PER_S)) for k in range(5, 10)]
    assert told == [None, None, 100.0, None, None]
    assert mapping.epoch == 1
    assert mapping.at(7 * NS_PER_S).utc_ns == UTC0 + 107 * NS_PER_S


def test_one_wrong_date_changes_nothing() -> None:
    mapping = started(ClockMap())
    assert mapping.add(pair(5 * NS_PER_S, UTC0 + 86_400 * NS_PER_S)) is None
    assert mapping.add(pair(6 * NS_PER_S, UTC0 + 6 * NS_PER_S)) is None
    assert mapping.epoch == 0
    assert mapping.at(6 * NS_PER_S).utc_ns == UTC0 + 6 * NS_PER_S


def test_two_receivers_that_disagree_do_not_step_to_and_fro() -> None:
    mapping, steps = started(ClockMap()), []
    for k in range(5, 60):
        mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S))
        wrong = ClockPair(sensor="gps2", t_ns=k * NS_PER_S, utc_ns=UTC0 + (k + 50) * NS_PER_S, source="RMC")
        steps.append(mapping.add(wrong))
    assert set(steps) == {None}


def test_a_first_default_date_is_not_believed() -> None:
    mapping = ClockMap()
    mapping.add(pair(0, UTC0 - 10**9 * NS_PER_S))
    assert mapping.at(0).utc_ns is None
    for k in range(1, 4):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S)) is None
    assert mapping.at(3 * NS_PER_S).utc_ns == UTC0 + 3 * NS_PER_S
    assert mapping.epoch == 0
