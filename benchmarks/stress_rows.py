"""Rows of the stress bench: each world beside the acceptance limits of issue 15 that it must hold."""

import fnmatch
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from benchmarks.stress_messages import IMU_FAULTS
from benchmarks.stress_world import Fault, Sky, World
from common.errors import WayfixError


@dataclass(frozen=True, slots=True)
class Ask:
    """A limit on one figure."""

    figure: str
    least: float = -math.inf
    most: float = math.inf

    def holds(self, value: float) -> bool:
        """NaN never holds."""
        return self.least <= value <= self.most

    def __str__(self) -> str:
        if self.least == -math.inf:
            return f"<={self.most:g}"
        return f">={self.least:g}" if self.most == math.inf else f"{self.least:g}..{self.most:g}"


@dataclass(frozen=True, slots=True)
class Row:
    """One world, what is asked of it, and the world that its position is compared with (`beside_ratio`)."""

    name: str
    world: World
    asks: tuple[Ask, ...] = ()
    beside: World | None = None
    start: float | None = None
    """Quantile of error over own sigma in the first 60 s aligned, 0 to 1; `None` = the row is no start."""
    filters: tuple[str, ...] = ("fuzzy",)
    seconds: float = 600.0


HEALTHY: Final = World()
NO_BLAME: Final = Ask("blamed", most=0)
IN95: Final = Ask("in95", least=0.90)
MIDDLE_S: Final = 300.0
BLAMES: Final = {
    "gyro": ("gyro-set-aside", "imu-repeats"),
    "compass": ("compass-set-aside",),
    "velocity": ("velocity-set-aside",),
}
"""Codes of the events that put the blame on a sensor."""


def most(figure: str, limit: float) -> Ask:
    """The figure is at most the limit."""
    return Ask(figure, most=limit)


def rows_named(patterns: Sequence[str]) -> list[Row]:
    """Rows whose name or beginning of a name fits one of the patterns, none = all.

    Raises: WayfixError when a pattern fits no row.
    """
    if not patterns:
        return list(ROWS)
    for pattern in patterns:
        if not any(_fits(row.name, pattern) for row in ROWS):
            raise WayfixError(f"no row is called {pattern}", "benchmarks.stress", "see --list")
    return [row for row in ROWS if any(_fits(row.name, pattern) for pattern in patterns)]


def _fits(name: str, pattern: str) -> bool:
    return fnmatch.fnmatch(name, pattern) or name.startswith(f"{pattern}-")


def _white() -> Iterator[Row]:
    yield Row("white", HEALTHY, (most("position_m", 0.60), Ask("in95", least=0.92), NO_BLAME))
    without = HEALTHY.without_velocity()
    yield Row("white-nov", without, (most("position_m", 1.2), Ask("in95", least=0.92), NO_BLAME))


def _lasting() -> Iterator[Row]:
    asks = Ask("in95", 0.90, 0.99), most("raw_ratio", 1.0)
    for tau_s in (20, 60, 120, 300, 600):
        yield Row(f"lasting-{tau_s}", _wandering(tau_s), asks)
    for gps_hz in (5, 10):
        yield Row(f"lasting-120-{gps_hz}hz", replace(_wandering(120), gps_hz=float(gps_hz)), asks)
    yield Row("lasting-300-anchor", replace(_wandering(300), track="anchor"), asks)
    for tau_s in (60, 120, 300):
        yield Row(f"lasting-{tau_s}-nov", _wandering(tau_s).without_velocity(), asks)


def _wandering(tau_s: float) -> World:
    return replace(HEALTHY, sky=(Sky(0.0, 0.4, 1.5),), lasting_s=float(tau_s))


def _velocity() -> Iterator[Row]:
    beside = HEALTHY.without_velocity()
    for name, kind, from_s, size, found_s in (
        ("velocity-wrong", "wrong", 0.0, 2.0, 20.0),
        ("velocity-wrong-middle", "wrong", MIDDLE_S, 2.0, 20.0),
        ("velocity-frozen", "frozen", MIDDLE_S, 0.0, math.inf),
        ("velocity-0.3", "wrong", MIDDLE_S, 0.3, 120.0),
    ):
        parts = (("", max(60.0, from_s), math.inf),)
        world = replace(HEALTHY, velocity_fault=Fault(kind=kind, from_s=from_s, size=size), parts=parts)
        asks = [most("beside_ratio", 1.3)] if size != 0.3 else []
        asks += [most("velocity_named_s", found_s)] if math.isfinite(found_s) else []
        yield Row(name, world, tuple(asks), replace(beside, parts=parts))
    yield Row("velocity-late-1s", replace(HEALTHY, velocity_late_s=1.0), (most("beside_ratio", 0.75),), beside)
    late = replace(HEALTHY, speed_m_s=6.0, position_late_s=0.5, sky=(Sky(0.0, 1.0),))
    yield Row("position-late-6ms", late, (most("position_m", 1.5), Ask("in95", least=0.85)))


def _compass() -> Iterator[Row]:
    yield Row("deviation-8", replace(HEALTHY, deviation_deg=8.0), (most("heading_e_s", 1.0), NO_BLAME))
    yield Row("deviation-20", replace(HEALTHY, deviation_deg=20.0), (most("heading_e_s", 1.7), NO_BLAME))
    yield Row("compass-2deg-60s", replace(HEALTHY, compass_lasting_deg=2.0), (most("heading_e_s", 1.3), NO_BLAME))


def _heel() -> Iterator[Row]:
    for speed_m_s, without_m, levelled_m, white_m, turn_deg_s in (
        (3.0, 1.2, 1.0, 1.0, (3.0, 12.0)),
        (6.0, 1.3, 1.1, 1.0, (3.0, 12.0)),
        (10.0, 2.1, 1.8, 1.5, (12.0, 12.0)),
    ):
        world = replace(HEALTHY, speed_m_s=speed_m_s, turn_deg_s=turn_deg_s, sky=(Sky(0.0, white_m),))
        yield Row(f"heel-{speed_m_s:g}", world, (most("position_m", 0.7), NO_BLAME))
        world = world.without_velocity()
        yield Row(f"heel-{speed_m_s:g}-nov", world, (most("position_m", without_m), NO_BLAME))
        levelled = replace(world, gives_roll=True)
        yield Row(f"heel-{speed_m_s:g}-roll-nov", levelled, (most("position_m", levelled_m), NO_BLAME))


def _imu() -> Iterator[Row]:
    for tail, base in (("", HEALTHY), ("-nov", HEALTHY.without_velocity())):
        for onset, from_s in (("", 0.0), ("-middle", MIDDLE_S)):
            parts = (("", max(60.0, from_s), math.inf),)
            for kind in IMU_FAULTS:
                named_s = 8.0 if kind == "rad-s" else 5.0
                asks: tuple[Ask, ...] = (
                    most("beside_ratio", 1.10),
                    most("heading_deg", 3.0 if tail else 2.0),
                    most("imu_named20_s", 12.0 if tail else named_s),
                    most("compass_blamed", 0),
                )
                if kind == "turned-90":
                    # Only the accelerometers are turned.
                    asks = (*asks, most("gyro_blamed", 0))
                if kind in {"zero", "stuck"} and from_s:
                    # Five samples of 10 Hz, and the frame in which they come.
                    asks = (*asks, most("imu_onset_s", 1.0))
                world = replace(base, imu_fault=Fault(kind=kind, from_s=from_s), parts=parts)
                yield Row(f"imu-{kind}{onset}{tail}", world, asks, replace(base.without_imu(), parts=parts))


def _magnetic() -> Iterator[Row]:
    fault = Fault(kind="magnetic", from_s=MIDDLE_S, to_s=MIDDLE_S + 60.0, size=25.0)
    world = replace(HEALTHY, disturbance=fault, parts=(("", MIDDLE_S, MIDDLE_S + 60.0),))
    never = most("gyro_blamed", 0)
    yield Row("magnetic", world, (most("compass_named_s", 5.0), most("heading_deg", 2.0), never))
    yield Row("magnetic-nov", world.without_velocity(), (never, most("heading_e_s", 1.7)))


def _false_blame() -> Iterator[Row]:
    """Beside deviation-20 and heel-6, which ask it too."""
    yield Row("gyro-scale-1pc", replace(HEALTHY, gyro_scale=0.01), (NO_BLAME,))
    yield Row("gyro-scale-1pc-nov", replace(HEALTHY, gyro_scale=0.01).without_velocity(), (NO_BLAME,))
    yield Row("waves-12", replace(HEALTHY, waves_deg=12.0), (NO_BLAME,))
    yield Row("waves-12-nov", replace(HEALTHY, waves_deg=12.0).without_velocity(), (NO_BLAME,))


def _outages() -> Iterator[Row]:
    for outage_s, end_m in ((10, 4.0), (30, 9.0), (60, 10.0), (120, 10.0)):
        world = replace(HEALTHY, current_m_s=0.5, outage_s=float(outage_s), parts=())
        asks = most("position_m", end_m), IN95, Ask("position_e_s", least=0.4)
        yield Row(f"outage-{outage_s}", world, asks, seconds=500.0)


def _qualities() -> Iterator[Row]:
    rtk, single, floating = (0.01, 0.0, 4), (0.3, 3.0, 1), (0.02, 0.3, 5)
    sky = tuple(Sky(120.0 * k, *each) for k, each in enumerate((rtk, single, rtk, floating, rtk)))
    names = "rtk1", "single", "rtk2", "float", "rtk3"
    # A second after a change its first fix has arrived.
    parts = tuple((name, max(60.0, 120.0 * k + 1.0), 120.0 * (k + 1)) for k, name in enumerate(names))
    world = replace(HEALTHY, gps_hz=5.0, sky=sky, lasting_s=120.0, sigma_m=3.0, parts=parts)
    asks = tuple(Ask(f"in95.{name}", least=0.90) for name in names)
    shown = tuple(most(f"position_shown_m.{name}", 0.1) for name in names if name.startswith("rtk"))
    yield Row("rtk-single-float", world, (*asks, *shown))
    ferry = replace(HEALTHY, speed_m_s=0.1, sky=(Sky(0.0, 0.01, 0.0, 4),), at_fixes=True)
    # Stamped and known just before a frame ends, so that the estimate of that frame is one at the fix.
    ferry = replace(ferry, gps_arrives_s=0.0, gps_phase_s=-0.001)
    yield Row("ferry", ferry, (most("raw_ratio", 1.1),))
    yield Row("ferry-noimu", ferry.without_imu(), (most("raw_ratio", 1.1),))


def _without_compass() -> Iterator[Row]:
    world = replace(HEALTHY, has_compass=False, current_m_s=0.5, any_estimate=True)
    honest = most("heading_e_s", 1.0), Ask("given", least=0.99)
    yield Row("no-compass", world, honest)
    yield Row("no-compass-noimu", world.without_imu(), honest)
    yield Row("no-compass-nov", world.without_velocity(), honest)
    yield Row("astern", replace(HEALTHY, speed_m_s=-1.5), honest)
    rest = replace(world, track="rest", current_m_s=0.0, waves_deg=0.0).without_imu()
    yield Row("gps-only-rest", rest, honest)
    yield Row("gps-only-rest-nov", rest.without_velocity(), honest)


WAIT_S: Final[dict[str, float]] = {}
"""Mean wait of `fuzzy`, as it was before issue 15, s."""


def _starts() -> Iterator[Row]:
    for tail, gps_hz, compass_hz, quantile, longer_s in (("", 5.0, 10.0, 0.99, 3.0), ("-1hz", 1.0, 1.0, 0.95, 10.0)):
        world = replace(HEALTHY, gps_hz=gps_hz, compass_hz=compass_hz)
        for name, other in (
            ("told", world),
            ("compass-x10", replace(world, compass_deg=10.0)),
            ("compass-x0.2", replace(world, compass_deg=0.2)),
            ("fixes-x7", replace(world, sky=(Sky(0.0, 10.5),), sigma_m=1.5)),
        ):
            whole = f"start-{name}{tail}"
            asks = [most("start_position", 3.5), most("start_heading", 3.5)]
            if whole in WAIT_S:
                asks.append(most("wait_s", WAIT_S[whole] + longer_s))
            yield Row(whole, other, tuple(asks), None, quantile, ("fuzzy", "imm", "fuzzy-qr"), 120.0)


ROWS: Final = (
    *_white(),
    *_lasting(),
    *_velocity(),
    *_compass(),
    *_heel(),
    *_imu(),
    *_magnetic(),
    *_false_blame(),
    *_outages(),
    *_qualities(),
    *_without_compass(),
    *_starts(),
)
