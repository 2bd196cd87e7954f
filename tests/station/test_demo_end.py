"""When a demo stops its daemon: a station on a slow machine is behind it, and would lose its last messages."""

from types import SimpleNamespace

from common.units import NS_PER_S
from shore.demo import CATCH_UP_S, Demo, DemoOptions


def is_complete(behind_s: float, missing: int, since_done_s: float) -> bool:
    """What a demo at eight times the speed says of a station that far behind."""
    demo = Demo(DemoOptions("5.3", 1, 8.0, None, ("fuzzy",), None), say=print)
    newest_ns = demo._clock.now_ns() - round(behind_s * 8.0 * NS_PER_S)
    demo._live_run = SimpleNamespace(t_ns=newest_ns, missing_count=missing)  # type: ignore[assignment]
    return demo._is_complete(round(since_done_s * NS_PER_S))


def test_the_daemon_stops_when_the_station_has_all_frames() -> None:
    assert is_complete(0.2, missing=0, since_done_s=0.5)
    assert not is_complete(0.2, missing=0, since_done_s=0.1)  # the last GPS epoch is still open


def test_a_station_that_is_behind_is_waited_for() -> None:
    assert not is_complete(4.0, missing=0, since_done_s=10.0)
    assert not is_complete(0.2, missing=3, since_done_s=10.0)
    assert is_complete(4.0, missing=0, since_done_s=CATCH_UP_S + 1.0)
