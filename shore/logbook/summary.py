"""Trip statistics (distance, speed, area, events), gathered while a log is written or by reading it once."""

from collections import Counter
from typing import Any, Final

from common.boat_start import BoatStart, StartOrder
from common.geodesy import LocalPlane
from common.messages import UTC_SOURCES, Frame
from common.units import NS_PER_S
from shore.logbook.greetings import take_greeting

KEPT: Final = ("name", "place", "note")
"""Fields that an operator gives to a trip, in `/session` records of kind `trip`; the last ones hold."""
LEG_NS: Final = NS_PER_S
"""Distance is summed over steps of this boat time, ns: shorter ones would count the noise."""
HOLE_NS: Final = 10 * NS_PER_S
"""Nothing is known of the time between two estimates that are further apart, ns."""
NOT_ALIGNED, UNKNOWN = "not aligned", "unknown"
"""What a position that is not valid, and a heading that is not known, rests on."""


class Rests:
    """For how long the estimates of one filter rested on what."""

    def __init__(self) -> None:
        self._times_ns: dict[str, Counter[str]] = {"position": Counter(), "heading": Counter()}
        self._newest_ns: int | None = None
        self._coasting_ns = self._longest_ns = 0
        """Boat time of the present stretch of dead reckoning, and of the longest, ns."""

    def take(self, record: dict[str, Any]) -> None:
        """Take an estimate that says what it rests on; it holds for the time since the one before."""
        t_ns, before_ns = record["t_ns"], self._newest_ns
        if record["position_from"] is None:
            return
        self._newest_ns = t_ns
        if before_ns is None or not 0 < t_ns - before_ns <= HOLE_NS:
            self._coasting_ns = 0
            return
        has_heading = record["heading_true_deg"] is not None
        position = record["position_from"] if "position" in record["aligned_parts"] else NOT_ALIGNED
        self._times_ns["position"][position] += t_ns - before_ns
        self._times_ns["heading"][record["heading_from"] if has_heading else UNKNOWN] += t_ns - before_ns
        self._coasting_ns = self._coasting_ns + t_ns - before_ns if record["position_from"] == "coasting" else 0
        self._longest_ns = max(self._longest_ns, self._coasting_ns)

    def as_record(self) -> dict[str, Any]:
        """Seconds by what position and heading rested on, and the longest stretch without a fix."""
        return {
            **{
                f"{part}_from_s": {word: round(time_ns / NS_PER_S, 1) for word, time_ns in sorted(times_ns.items())}
                for part, times_ns in self._times_ns.items()
            },
            "longest_coasting_s": round(self._longest_ns / NS_PER_S, 1),
        }


class UtcOfClocks:
    """UTC as the boat knows it (GNSS before NTP before a real-time clock), one offset for each clock of the board."""

    def __init__(self, starts: StartOrder) -> None:
        """starts: order of the board's starts, as far as it is known when `span` is asked for."""
        self._starts = starts
        self._offsets: dict[str, tuple[int, int]] = {}
        """Rank of the source, and UTC less boat time (ns), by clock_id; the newest of the best source."""
        self._spans: dict[str, tuple[BoatStart, int, int]] = {}
        """One start, first t0_ns and last t1_ns, by clock_id."""

    def take(self, frame: Frame) -> None:
        """Take a frame, in any order."""
        start, first_ns, last_ns = self._spans.get(frame.clock_id, (BoatStart.of(frame), frame.t0_ns, frame.t1_ns))
        self._spans[frame.clock_id] = start, min(first_ns, frame.t0_ns), max(last_ns, frame.t1_ns)
        rank = UTC_SOURCES.index(frame.utc_src)
        if frame.utc_ns is not None and rank >= max(1, self._offsets.get(frame.clock_id, (0, 0))[0]):
            self._offsets[frame.clock_id] = rank, frame.utc_ns - frame.t0_ns

    def of(self, t_ns: int) -> int | None:
        """UTC of a boat time, ns; `None` where it is not known, or the board had several clocks."""
        if len(self._spans) != 1 or not self._offsets:
            return None
        ((_, offset_ns),) = self._offsets.values()
        return t_ns + offset_ns

    def span(self) -> tuple[int | None, int | None]:
        """UTC of the first and of the last frame, ns; `None` = the boat did not know it."""
        if not self._spans:
            return None, None
        order = [start.clock_id for start in self._starts.sorted(start for start, _, _ in self._spans.values())]
        first, last = order[0], order[-1]
        return self._utc_of(first, self._spans[first][1]), self._utc_of(last, self._spans[last][2])

    def _utc_of(self, clock_id: str, t_ns: int) -> int | None:
        return t_ns + self._offsets[clock_id][1] if clock_id in self._offsets else None


class TripSummary:
    """Feed it every record of a log in file order."""

    def __init__(self) -> None:
        self._words: dict[str, str | None] = dict.fromkeys(KEPT)
        self._boat: str | None = None
        self._utc_ns: int | None = None
        self._frames = self._fixes = 0
        self._spans: dict[tuple[str, str], tuple[int, int]] = {}
        """First t0_ns and last t1_ns of each start of the daemon, by clock_id and boot_id: between them nothing ran."""
        self._starts = StartOrder()
        self._clocks = UtcOfClocks(self._starts)
        self._filters: list[str] = []
        self._levels: Counter[str] = Counter()
        self._area: tuple[float, float, float, float] | None = None
        """Southern, northern, western and eastern limit of the trip, deg."""
        self._last: tuple[int, float, float] | None = None
        """Boat time (ns), latitude and longitude (deg) of the last place that was counted."""
        self._distance_m = self._fastest_kn = 0.0
        self._rests = Rests()

    def session(self, record: dict[str, Any], log_time_ns: int) -> None:
        """Take a `/session` record."""
        take_greeting(self._starts, record)
        if record.get("kind") == "trip":
            self._words |= {name: record[name] for name in KEPT if record.get(name)}
        elif record.get("kind") == "start" and self._utc_ns is None:
            self._utc_ns = record.get("utc_ns", log_time_ns)
            self._boat = record.get("connected", {}).get("config", {}).get("boat", {}).get("id")

    def frame(self, frame: Frame) -> None:
        """Take a frame of the board, in any order."""
        self._frames += 1
        self._clocks.take(frame)
        self._fixes += sum(fix.usable for fix in frame.fixes)
        ran = frame.clock_id, frame.boot_id
        first_ns, last_ns = self._spans.get(ran, (frame.t0_ns, frame.t1_ns))
        self._spans[ran] = min(first_ns, frame.t0_ns), max(last_ns, frame.t1_ns)

    def estimate(self, record: dict[str, Any]) -> None:
        """Take a published estimate; place and speed are those of the first filter while its position is valid."""
        if record["filter"] not in self._filters:
            self._filters.append(record["filter"])
        if record["filter"] != self._filters[0]:
            return
        self._rests.take(record)
        if "position" not in record["aligned_parts"]:
            return
        t_ns, lat_deg, lon_deg = record["t_ns"], record["lat_deg"], record["lon_deg"]
        if self._last is not None and 0 <= t_ns - self._last[0] < LEG_NS:
            return
        if self._last is not None and t_ns > self._last[0]:
            east_m, north_m = LocalPlane(self._last[1], self._last[2]).to_east_north_m(lat_deg, lon_deg)
            self._distance_m += (east_m**2 + north_m**2) ** 0.5
        south, north, west, east = self._area or (lat_deg, lat_deg, lon_deg, lon_deg)
        self._area = min(south, lat_deg), max(north, lat_deg), min(west, lon_deg), max(east, lon_deg)
        self._fastest_kn = max(self._fastest_kn, record["sog_kn"] or 0.0)
        self._last = t_ns, lat_deg, lon_deg

    def event(self, level: str) -> None:
        """Count an event of this level."""
        self._levels[level] += 1

    @property
    def utc(self) -> "UtcOfClocks":
        """What the boat said of UTC."""
        return self._clocks

    @property
    def has_place(self) -> bool:
        """True once an estimate was aligned."""
        return self._area is not None

    def as_record(self) -> dict[str, Any]:
        """The whole summary for JSON; places are `None` while no position was valid."""
        area = self._area or (None, None, None, None)
        begin_ns, end_ns = self._clocks.span()
        return {
            **self._words,
            "boat": self._boat,
            "utc_ns": self._utc_ns if begin_ns is None else begin_ns,
            "end_utc_ns": end_ns,
            "seconds": round(self._span_s(), 3),
            "frames": self._frames,
            "fixes": self._fixes,
            "filters": self._filters,
            "events": dict(sorted(self._levels.items())),
            "distance_m": round(self._distance_m, 1),
            "max_sog_kn": round(self._fastest_kn, 2),
            **self._rests.as_record(),
            **dict(zip(("south_deg", "north_deg", "west_deg", "east_deg"), area, strict=True)),
        }

    def _span_s(self) -> float:
        """Boat time covered, over all starts of the daemon."""
        return sum(last_ns - first_ns for first_ns, last_ns in self._spans.values()) / NS_PER_S
