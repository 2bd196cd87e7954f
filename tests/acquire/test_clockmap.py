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


def test_a_step_is_told_once_and_starts_a_new_epoch() -> None:
    mapping = ClockMap()
    mapping.add(pair(0, UTC0))
    step_s = mapping.add(pair(NS_PER_S, UTC0 + 101 * NS_PER_S))
    assert step_s == 100.0
    assert mapping.epoch == 1
    assert mapping.add(pair(2 * NS_PER_S, UTC0 + 102 * NS_PER_S)) is None
    assert mapping.at(2 * NS_PER_S).utc_ns == UTC0 + 102 * NS_PER_S
