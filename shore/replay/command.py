"""`wayfix replay` (command line): a log through the filters again, compared with the live run or a reference."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.command import number, printable
from common.errors import WayfixError
from common.words import counted
from shore.settings.arguments import add_filter_arguments, add_settings
from shore.terminal import add_json, every_end_is_ctrl_c, filters_named, finish, say, tell

if TYPE_CHECKING:
    from shore.replay.comparison import Comparison, Counts
    from shore.replay.frames import Span
    from shore.replay.run import Replay
    from shore.report.score import Consistency, Score
    from shore.watchers.watcher import Watcher

LONGEST_S = 1e9
VERDICTS_SHOWN = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix replay`."""
    parser.add_argument("log", type=Path, help="a log of `wayfix connect`, `demo`, `import` or `replay --record`")
    parser.add_argument(
        "--reference",
        type=Path,
        metavar="FILE",
        help="the true track: GPX, or CSV t_s|utc|t_ns,lat_deg,lon_deg[,heading_true_deg]",
    )
    parser.add_argument(
        "--order",
        choices=("arrival", "time"),
        default="arrival",
        help="arrival: as live (default); time: by the boat's clock, late frames in their place, the best track",
    )
    add_span(parser)
    parser.add_argument(
        "--speed",
        type=number(float, 0.01, 10_000.0),
        metavar="X",
        help="boat seconds per second, with the live run's status line (default: as fast as it can, without)",
    )
    parser.add_argument(
        "--smooth",
        type=Path,
        metavar="OUT.csv",
        help="write the first filter's smoothed track: every estimate knows the whole log",
    )
    parser.add_argument(
        "--record", type=Path, metavar="OUT.mcap", help="write a new log: the same frames, the new estimates and events"
    )
    parser.add_argument(
        "--inject",
        metavar="FAULT",
        action="append",
        default=[],
        help="break a sensor: 'compass2 step 30 deg at 120 s for 60 s' (docs/simulation.md); give it again for more",
    )
    add_settings(parser, ": [limits] and [display], for --speed; filters and step are the log's")
    add_filter_arguments(parser, "those of the log")
    add_json(parser)


def add_span(parser: argparse.ArgumentParser) -> None:
    """Add `--from` and `--to`."""
    seconds = number(float, 0.0, LONGEST_S)
    parser.add_argument("--from", dest="from_s", type=seconds, metavar="S", help="begin at this second of the log")
    parser.add_argument("--to", dest="to_s", type=seconds, metavar="S", help="end at this second of the log")


def span_of(arguments: argparse.Namespace) -> "Span":
    """The span asked for; raises WayfixError for one that ends before it begins."""
    from shore.replay.frames import Span

    if None not in (arguments.from_s, arguments.to_s) and arguments.to_s <= arguments.from_s:
        raise WayfixError("--to lies before --from", cure="give --from S --to T with S < T")
    return Span(arguments.from_s, arguments.to_s)


def run(arguments: argparse.Namespace) -> int:
    """Feed a log's frames to the filters again; compare with the recorded estimates and a reference; 1 = it differs."""
    from common.atomic_file import check_target
    from shore.replay.run import Replay
    from shore.report.score import consistency_table, score_table

    filters = filters_named(arguments.filters) if arguments.filters else None
    inputs = [path for path in (arguments.log, arguments.reference) if path]
    if arguments.smooth:
        check_target(arguments.smooth, inputs, "choose another --smooth file")
    if arguments.record:
        check_target(arguments.record, inputs, "choose another --record file")
        if arguments.record == arguments.smooth:
            raise WayfixError("--record and --smooth name one file", str(arguments.record), "give two names")
    if arguments.settings and not arguments.speed:
        raise WayfixError("--settings needs --speed", cure="give --speed X too: without it, nothing of them is read")
    span, inject = span_of(arguments), arguments.inject
    replay = Replay(arguments.log, filters, arguments.step, arguments.order, span, inject=inject)
    with every_end_is_ctrl_c():
        looked = Looked(arguments, replay)
        is_whole = looked.play()
        if not replay.frames:
            if not is_whole:
                return 0
            raise WayfixError(*_empty(arguments, replay))
        summary = _told(arguments, replay, is_whole)
        if arguments.smooth and is_whole:
            summary["smoothed"] = looked.smooth(arguments.smooth)
    summary["filters"] = looked.consistency.summary()
    if filters or arguments.reference or arguments.smooth:
        tell(consistency_table(summary["filters"]))
    if looked.score is not None:
        looked.score.check(arguments.reference)
        scores = looked.score.summary()
        summary.update(scores)
        tell(score_table(scores))
    finish(arguments, summary)
    return int(is_whole and replay.differs)


class Looked:
    """What a replay is for: everything that looks at its steps."""

    def __init__(self, arguments: argparse.Namespace, replay: "Replay") -> None:
        from shore.watchers.score import ConsistencyWatcher, DoubtWatcher, ScoreWatcher

        self._arguments = arguments
        self._replay = replay
        self._live = DoubtWatcher(replay.filters[0]) if arguments.smooth else None
        self._consistency = ConsistencyWatcher()
        self._score = ScoreWatcher(arguments.reference, self._utc_offset_ns) if arguments.reference else None

    @property
    def consistency(self) -> "Consistency":
        """Consistency (NIS, sigma) of every filter."""
        return self._consistency.consistency

    @property
    def score(self) -> "Score | None":
        """Score against the reference, when one was given and a frame came."""
        return None if self._score is None else self._score.score

    def _utc_offset_ns(self) -> int | None:
        """UTC less boat time, by the log's frames (`None` = they do not say)."""
        from shore.imports.framed_recording import decoded
        from shore.imports.recording_date import utc_offset_ns
        from shore.logbook.log_reader import read_log

        return utc_offset_ns(decoded(read_log(self._arguments.log).frames()))

    def play(self) -> bool:
        """The whole replay; False after Ctrl-C, which leaves no half file."""
        from shore.replay.run import Pace
        from shore.watchers.log import WholeLog
        from shore.watchers.watcher import Watchers

        arguments, replay = self._arguments, self._replay
        asked = (self._score, self._live)
        watchers: list[Watcher] = [self._consistency, *(each for each in asked if each is not None)]
        pace = Pace(arguments.speed) if arguments.speed else None
        try:
            with ExitStack() as stack:
                if pace is not None:
                    watchers += _shown(arguments.settings, replay.filters[0], arguments.speed)
                elif (progress := stack.enter_context(_progress("replaying"))) is not None:
                    watchers.append(progress)
                if arguments.record is not None:
                    watchers.append(stack.enter_context(WholeLog(arguments.record)))
                replay.run(Watchers(*watchers), pace)
        except KeyboardInterrupt:
            say(f"stopped after {counted(replay.frames, 'frame')}")
            return False
        return True

    def smooth(self, path: Path) -> dict[str, Any]:
        """Write the smoothed track; raises WayfixError."""
        from shore.replay.run import smoothed
        from shore.replay.smooth import write_track
        from shore.report.own_doubt import verdict

        name = self._replay.filters[0]
        track = smoothed(self._arguments.log, name, span_of(self._arguments), self._replay.inject)
        with _progress("smoothing"):
            count = write_track(path, self._scored(track))
        inside = self._live.doubt.summary() if self._live else {}
        if count:
            made = counted(count, "smoothed estimate")
            tell(f"{made} of {name} in {path}: each knows the whole log, none was seen live")
            tell(f"{name}: {verdict(inside)}")
        else:
            say(f"no smoothed estimates of {name}, {path} has no row: {self._replay.why_none or 'no filter started'}")
        return {"estimates": count, "file": str(path), "inside_95": inside}

    def _scored(self, track: Iterator[Any]) -> Iterator[Any]:
        for estimate in track:
            if self._live is not None:
                self._live.doubt.compare(estimate)
            if self.score is not None:
                self.score.take_estimate(estimate.as_record())
            yield estimate


def _shown(settings_file: Path | None, name: str, speed: float) -> "list[Watcher]":
    """What a live run says: events as they come, a status line each second."""
    from shore.settings.station import station_settings
    from shore.watchers.say import SayEvents
    from shore.watchers.status import StatusLine

    settings = station_settings(settings_file)
    return [SayEvents(say, settings), StatusLine(name, say, settings, boat_seconds_per_s=speed)]


def _empty(arguments: argparse.Namespace, replay: "Replay") -> tuple[str, str, str]:
    """The sentence for a replay without a frame."""
    if arguments.from_s or arguments.to_s is not None:
        return "holds no frame there", str(arguments.log), "give another --from or --to"
    damage = f" ({replay.damage})" if replay.damage else ""
    return f"holds no frame{damage}", str(arguments.log), "give a log with frames in it"


def _told(arguments: argparse.Namespace, replay: "Replay", is_whole: bool) -> dict[str, Any]:
    """Say what was read, made and found again; the same for `--json`."""
    from common.simulation.faults import NOTHING_CHANGED

    tell(f"{arguments.log}: {counted(replay.frames, 'frame')}, filters {', '.join(replay.filters)}")
    _tell_order(replay)
    if replay.damage:
        say(f"{arguments.log}: {replay.damage}; all frames that are sound were replayed")
    if replay.why_none is not None:
        say(f"{arguments.log}: no estimates: {replay.why_none}")
    for fault, count in replay.source.injected.items():
        tell(f"injected: {fault} ({counted(count, 'reading')} changed)")
        if not count:
            say(f"--inject: {fault!r} changes nothing; {NOTHING_CHANGED}")
    summary: dict[str, Any] = {
        "order": replay.order,
        "injected": replay.source.injected,
        "why_no_estimates": replay.why_none,
        "whole": is_whole,
        "frames": {"read": replay.frames, "bad": replay.source.bad, "late": replay.source.late},
        **_compared(replay),
    }
    if arguments.record:
        summary["recorded"] = str(arguments.record) if is_whole else None
        tell(f"new log {arguments.record}" if is_whole else f"{arguments.record} was not written")
    return summary


def _tell_order(replay: "Replay") -> None:
    from shore.navigation.timeline import HORIZON_S

    late = replay.source.late
    if replay.order == "time":
        tell("in order of boat time, late frames in their place: the best track, not what was seen live")
    elif late:
        tell(f"{counted(late, 'frame')} came more than {HORIZON_S:g} s late; --order time puts them in their place")


def _compared(replay: "Replay") -> dict[str, Any]:
    """Say how the replay compares with the live run."""
    from shore.replay.comparison import Counts

    comparison = replay.comparison
    if comparison is None or not comparison.estimates.recorded:
        why_not = replay.why_not or "the log holds none of these filters"
        if replay.order != "time":
            tell(f"estimates are not compared with recorded ones: {why_not}")
        counts = Counts(made=replay.estimates)
        return {"estimates": {**asdict(counts), "not_compared": why_not}, "events": None, "first_difference": None}
    if replay.other_arithmetic:
        tell(_other_arithmetic(replay.other_arithmetic))
    tell(_counted("estimates", comparison.estimates))
    if comparison.events:
        tell(_counted("events", comparison.events))
    first = comparison.first
    if first is not None:
        tell(f"first difference: {first}")
        _tell_versions(replay)
    _tell_verdicts(comparison)
    return {
        "other_arithmetic": replay.other_arithmetic,
        "estimates": asdict(comparison.estimates),
        "events": asdict(comparison.events) if comparison.events else None,
        "first_difference": asdict(first) if first else None,
        "verdicts": [asdict(verdict) for verdict in comparison.verdicts],
    }


def _other_arithmetic(differing: str) -> str:
    from shore.logbook.estimate_rounding import TOLERANCE

    return (
        f"the log {printable(differing)}: estimates are compared within {TOLERANCE:g} "
        "(m, m/s, rad, deg; the covariance in shares of its sigmas), not bit for bit"
    )


def _tell_verdicts(comparison: "Comparison") -> None:
    for verdict in comparison.verdicts[:VERDICTS_SHOWN]:
        tell(f"  {verdict}")
    if (more := comparison.verdict_count - VERDICTS_SHOWN) > 0:
        tell(f"  and {more} more")


def _counted(kind: str, counts: "Counts") -> str:
    text = f"{kind} equal to the recorded ones: {counts.equal} of {counts.recorded}"
    if counts.near:
        text += f", {counts.near} within the tolerance"
    if not counts.differs:
        return text
    return f"{text}; {counts.different} different, {counts.missing} not made again, {counts.extra} not in the log"


def _tell_versions(replay: "Replay") -> None:
    """Report other versions, but those that the sentence on the arithmetic reports."""
    from shore.logbook.arithmetic import VERSIONS, arithmetic_of
    from shore.logbook.session import start_record

    recorded, ours = replay.start.record.get("versions") or {}, start_record({}, {}, 0)["versions"]
    said = VERSIONS if arithmetic_of(replay.start.record) else ()
    changed = [name for name, here in ours.items() if recorded.get(name, here) != here and name not in said]
    others = [f"{name} {recorded[name]} (here {ours[name]})" for name in changed]
    if others:
        tell(f"the log was made with {', '.join(others)}")


def _progress(what: str) -> "AbstractContextManager[Watcher | None]":
    """A line on a terminal's stderr; `None` where stderr is no terminal."""
    if not (sys.stderr and sys.stderr.isatty()):
        return nullcontext()
    from shore.watchers.progress import Progress

    return Progress(what)
