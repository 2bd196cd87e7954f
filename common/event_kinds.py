"""Catalogue of events (alarms, notices): what each says and what to do."""

from dataclasses import dataclass
from typing import Final

BOARD: Final = "board"
FILTERS: Final = "filters"
STATION: Final = "station"


@dataclass(frozen=True, slots=True)
class EventKind:
    """Text with {placeholders} filled from the evidence, the cure in one sentence, the level it has."""

    level: str
    text: str
    cure: str
    side: str = BOARD
    """Side that says it. A replay passes on what the `BOARD` said in its frames, repeats what the `FILTERS` say, and
    cannot make what the `STATION` said of its own link and log."""


EVENTS: Final[dict[str, EventKind]] = {
    "daemon-started": EventKind("info", "daemon started, configured sensors: {sensors}", "nothing to do"),
    "daemon-stopping": EventKind("info", "daemon stops: {reason}", "nothing to do"),
    "daemon-resumed": EventKind(
        "warning",
        "the former run ended without a goodbye: {gap_s} s without frames",
        "read the log of that time (`journalctl -u wayfix-onboard`) for a crash, a hang or a full memory",
    ),
    "port-opened": EventKind("info", "{port} open at {path}", "nothing to do"),
    "port-lost": EventKind("warning", "{port} lost: {reason}", "check plug and power; it is reopened by itself"),
    "port-missing": EventKind(
        "warning", "{port} cannot be opened: {reason}", "check the path in the configuration, plug and rights"
    ),
    "port-flooded": EventKind(
        "warning",
        "{port} sends more than {budget} bytes/s; the surplus is thrown away",
        "lower the device's output or raise byte_budget_per_s",
    ),
    "port-calm": EventKind("info", "{port} is within its byte budget again", "nothing to do"),
    "lines-damaged": EventKind(
        "warning",
        "{damaged} of the last {lines} lines of {port} came damaged",
        "check the plug, the baud rate, and that no other program (gpsd, ModemManager) reads the port",
    ),
    "lines-clean": EventKind("info", "the lines of {port} come whole again", "nothing to do"),
    "sensor-delivering": EventKind("info", "{sensor} delivers", "nothing to do"),
    "sensor-silent": EventKind(
        "warning",
        "{sensor} is silent for {age_s} s: {reason}",
        "check cable, baud rate and the device's output",
    ),
    "place-zero": EventKind(
        "warning",
        "{sensor} gives the place 0, 0, which stands for no place: such sentences are refused",
        "nothing, where the receiver has just been switched on; else check it",
    ),
    "clock-stepped": EventKind(
        "warning",
        "UTC of {sensor} jumped by {step_s} s against the boat clock",
        "check the receiver; times on the boat clock are not touched",
    ),
    "receivers-disagree": EventKind(
        "warning",
        "{sensor} and {other} give UTC {apart_s} s apart; that of {other} holds",
        "check both receivers' dates; the one that was there first holds until it falls silent",
    ),
    "week-rollover": EventKind(
        "warning",
        "{sensor} gives the date {date}, which is past; if its GPS weeks have begun anew, it is {later}: not used",
        "if the later date is right, set week_rollover = true at this sensor in the board's file",
    ),
    "week-rollover-repaired": EventKind(
        "warning",
        "{sensor} gives the date {date}, its GPS weeks have begun anew: {later} is used",
        "update the receiver's firmware, or replace it when you can",
    ),
    "date-refused": EventKind(
        "warning", "{sensor} gives the date {date}, which cannot be: it is not used", "check the receiver"
    ),
    "frame-failed": EventKind(
        "error", "frame {seq} could not be encoded and was not sent: {reason}", "report this configuration"
    ),
    "ticks-missed": EventKind("warning", "the board slept, frame periods passed at once: {count}", "nothing to do"),
    "client-joined": EventKind("info", "client {client} joined", "nothing to do"),
    "client-left": EventKind("info", "client {client} left: {reason}", "nothing to do"),
    "frames-gone": EventKind(
        "warning",
        "frames from {seq} on that the boat does not hold any more, so that they are lost: {count}",
        "give the board's [spool] more room, or a card that is faster",
        side=STATION,
    ),
    "starts-lost": EventKind(
        "warning",
        "{reason}; frames that are lost: {count}",
        "look why the daemon starts so often (`journalctl -u wayfix-onboard`); `wayfix-onboard spool export` has them",
        side=STATION,
    ),
    "gaps-filled": EventKind("info", "no frame is missing any more ({count} received)", "nothing to do", side=STATION),
    "command-done": EventKind("info", "{command}, asked by {client}", "nothing to do"),
    "mark": EventKind("info", "mark: {text} (by {client})", "nothing to do"),
    "command-refused": EventKind(
        "warning", "the command {command} of {client} was refused: its key may only read", "pair it with --command"
    ),
    "link-lost": EventKind(
        "warning",
        "no frame from the boat for {age_s} s",
        "check the radio link and the boat's power; the station goes on trying",
        side=STATION,
    ),
    "link-restored": EventKind("info", "frames arrive again after {age_s} s", "nothing to do", side=STATION),
    "log-behind": EventKind(
        "warning",
        "the disk of the log has been busy for {age_s} s: a power cut now takes that much of the log",
        "use a faster disk; nothing of the run waits for it",
        side=STATION,
    ),
    "log-again": EventKind(
        "warning",
        "the log {file} had ended by a fault of the disk; it goes on in {new}, and what is in neither comes once more",
        "look at the disk",
        side=STATION,
    ),
    "log-gone": EventKind(
        "warning",
        "the log {file} was removed or moved while it was written: {new} begins, and the boat sends the frames again",
        "leave a log alone until its run has ended",
        side=STATION,
    ),
    "daemon-restarted": EventKind(
        "warning", "the boat's daemon was restarted; the filters carry on", "nothing to do", side=FILTERS
    ),
    "config-changed": EventKind(
        "warning",
        "the boat came back with another configuration; the filters start anew",
        "nothing to do",
        side=STATION,
    ),
    "state-unusable": EventKind(
        "warning", "the start counter cannot be kept: {reason}", "give a writable --state directory"
    ),
    "state-gone": EventKind(
        "error",
        "the state directory {path} was removed or emptied: start counter and spool are made again",
        "put its keys back before the next start, or pair the stations again then; those that are paired now stay so",
    ),
    "state-mended": EventKind(
        "warning",
        "the start counter {reason}: this is start {start_no}",
        "nothing, after a power cut or where the card is of a backup; look at the card if it comes again",
    ),
    "station-refused": EventKind(
        "warning",
        "a station was refused: its key {fingerprint} is not on the allow list",
        "if it is yours, pair it: wayfix-onboard pair on the board, wayfix pair ashore",
    ),
    "pairing-open": EventKind("info", "pairing is open on port {port} for {seconds} s", "nothing to do"),
    "pairing-done": EventKind("info", "paired with {name}, key {fingerprint}, rights {rights}", "nothing to do"),
    "pairing-failed": EventKind(
        "warning",
        "pairing ended without a key: {reason}",
        "ask for a new code (wayfix-onboard pair); if that was not you ashore, somebody else is on this network",
    ),
    "keys-read": EventKind("info", "the allow list was read, stations on it: {count}", "nothing to do"),
    "keys-damaged": EventKind(
        "warning", "{file}: {count} faults, the first: {first}", "mend the file, then reload it (docs/security.md)"
    ),
    "key-revoked": EventKind("info", "the key of {name} was taken off the allow list", "nothing to do"),
    "peer-cut": EventKind(
        "warning",
        "connections were cut: {count}, the last from {address}: {reason}",
        "if that was one of yours, look at its program; else somebody on this network tries to stop the board",
    ),
    "link-open": EventKind(
        "warning",
        "OPEN LINK (--open): nothing is encrypted, whoever reaches {bind} reads and commands this boat",
        "leave --open out and pair the station, unless this network is yours alone",
    ),
    "control-unusable": EventKind(
        "warning", "no control socket: {reason}", "give a --runtime directory that the daemon may write"
    ),
    "board-rebooted": EventKind(
        "warning", "the board was rebooted; the filters start anew", "nothing to do", side=FILTERS
    ),
    "start-counter-back": EventKind(
        "warning",
        "the board counts its starts from {start_no} on again (before: {before})",
        "nothing for the frames, which come in the right order; look whether the board's card is the right one",
        side=FILTERS,
    ),
    "origin-moved": EventKind(
        "warning",
        "{count} fixes in a row lie more than {limit_km} km from the origin; the filters start anew there",
        "check the receiver if the boat has not been carried away",
        side=FILTERS,
    ),
    "filter-started": EventKind("info", "filters start at {lat_deg}, {lon_deg}", "nothing to do", side=FILTERS),
    "filter-waiting": EventKind("info", "filters wait for: {missing}", "check these sensors", side=FILTERS),
    "filter-aligned": EventKind(
        "info", "filters are aligned: estimates are valid from here on", "nothing to do", side=FILTERS
    ),
    "filter-reset": EventKind(
        "error",
        "filter {filter} gave no finite number and was started again",
        "report this log",
        side=FILTERS,
    ),
    "fix-zero": EventKind(
        "warning",
        "{sensor} gives the place 0, 0, which stands for no place: it is not used",
        "nothing, where the receiver has just been switched on; else check it",
        side=FILTERS,
    ),
    "fix-far": EventKind(
        "warning",
        "fix of {sensor} lies {distance_km} km from the mission's origin and is not used",
        "check the receiver",
        side=FILTERS,
    ),
    "late-dropped": EventKind(
        "warning",
        "{count} measurements of {sensor} came more than {limit_s} s late and were not fused",
        "kept in the log: `wayfix replay LOG --order time` puts them in their place",
        side=FILTERS,
    ),
    "ahead-dropped": EventKind(
        "warning",
        "{count} measurements of {sensor} are stamped more than {limit_s} s after their own frame and were not fused",
        "check the receiver's time; they are kept in the log",
        side=FILTERS,
    ),
    "imu-implausible": EventKind(
        "warning",
        "{count} samples of {sensor} show what no such sensor can measure and were not used",
        "check its cable, its scale and the model in the board's file",
        side=FILTERS,
    ),
    "imu-repeats": EventKind(
        "warning",
        "{sensor} repeats the same numbers and is not used; position and heading go on without it",
        "check its cable and its output; it is used again as soon as its numbers change",
        side=FILTERS,
    ),
    "imu-alive": EventKind("info", "the numbers of {sensor} change again: it is used", "nothing to do", side=FILTERS),
    "gyro-set-aside": EventKind(
        "warning",
        "the yaw rate of {sensor} contradicts what else shows the boat's turns and is not used",
        "check how the unit is mounted (upside down, turned), its sign and its unit (rad/s or deg/s)",
        side=FILTERS,
    ),
    "gyro-taken-back": EventKind(
        "info", "the yaw rate of {sensor} agrees with the turns again: it is used", "nothing to do", side=FILTERS
    ),
    "compass-set-aside": EventKind(
        "warning",
        "{sensor} contradicts gyro and course and is not used; the heading goes on without it",
        "look for iron or a current near the compass; it is used again when it agrees",
        side=FILTERS,
    ),
    "compass-taken-back": EventKind("info", "{sensor} is used again", "nothing to do", side=FILTERS),
    "velocity-set-aside": EventKind(
        "warning",
        "speed and course of {sensor} contradict its own positions and are not used",
        "check the receiver's output; they are used again when they agree",
        side=FILTERS,
    ),
    "velocity-taken-back": EventKind(
        "info",
        "speed and course of {sensor} agree with its positions again: they are used",
        "nothing to do",
        side=FILTERS,
    ),
    "fix-quality-changed": EventKind(
        "info", "fixes of {sensor} are {now} from here on (before: {before})", "nothing to do", side=FILTERS
    ),
    "fix-lost": EventKind(
        "warning",
        "there has been no usable fix for {seconds} s: positions are dead reckoning until the next one",
        "look at the antenna, its cable and what stands above it",
        side=FILTERS,
    ),
    "fix-regained": EventKind(
        "info", "fixes come again, after {seconds} s without: positions rest on them", "nothing to do", side=FILTERS
    ),
    "heading-unknown": EventKind(
        "warning",
        "the heading is not known; positions and speeds go on without it",
        "look at the compass; a boat without one shows its heading from about 2 kn on",
        side=FILTERS,
    ),
    "heading-from-course": EventKind(
        "info",
        "no compass gives a heading: it comes from the course over ground and the turns, good to {sigma_deg} deg",
        "current and leeway are in that doubt; going astern is not, and shows the opposite heading",
        side=FILTERS,
    ),
    "heading-from-compass": EventKind(
        "info", "the heading comes from a compass, good to {sigma_deg} deg", "nothing to do", side=FILTERS
    ),
    "variation-used": EventKind(
        "info",
        "magnetic variation here is {variation_deg} deg ({model}, east +, good to {doubt_deg} deg)",
        "nothing to do",
        side=FILTERS,
    ),
    "variation-doubted": EventKind(
        "warning",
        "{sensor} says that the variation is {variation_deg} deg; the magnetic model has {model_deg} deg here: that is"
        " used",
        "set the variation in the compass right, or state it as boat.variation_deg in the board's file, which wins",
        side=FILTERS,
    ),
    "variation-undated": EventKind(
        "warning",
        "the date is unknown: {variation_deg} deg of variation are those of {year}",
        "let the receiver send RMC or ZDA, or set boat.variation_deg in the board's file",
        side=FILTERS,
    ),
    "variation-expired": EventKind(
        "warning",
        "the date, {year}, is outside the years of the magnetic models: the variation of {used_year} is used",
        "update Wayfix or set boat.variation_deg in the board's file; if the date is wrong, check the receiver",
        side=FILTERS,
    ),
    "compass-weak": EventKind(
        "warning",
        "the earth's horizontal field is only {field_nt} nT here: compass and variation are to be used with caution",
        "near a magnetic pole use a satellite compass or a gyrocompass",
        side=FILTERS,
    ),
    "compass-useless": EventKind(
        "warning",
        "the earth's horizontal field is only {field_nt} nT here: compass and variation are unreliable",
        "near a magnetic pole use a satellite compass or a gyrocompass",
        side=FILTERS,
    ),
    "spool-damaged": EventKind(
        "warning",
        "{bytes} bytes at the end of the spool are no frames ({file}); all before them are kept",
        "after a power cut nothing; else check the card: `wayfix-onboard spool verify`",
    ),
    "spool-failed": EventKind(
        "error",
        "frames are not stored on disk, only in memory: {reason} ({path})",
        "check the card and the rights of the state directory; it is tried again by itself",
    ),
    "spool-locked": EventKind(
        "error",
        "another daemon stores its frames in {path}; those of this one are only in memory",
        "stop the other daemon, or give this one a --state directory of its own",
    ),
    "spool-gone": EventKind(
        "error",
        "the spool {path} was removed, or another disk is there: it begins again with the newest {count} frames",
        "leave the state directory alone while the daemon runs",
    ),
    "spool-restored": EventKind("info", "frames are stored on disk again", "nothing to do"),
    "spool-behind": EventKind(
        "warning", "the disk is too slow: frames from {seq} on are not stored on it", "use a faster card"
    ),
    "spool-caught-up": EventKind(
        "info", "the disk keeps up again; {dropped} frames of this start were not stored", "nothing to do"
    ),
    "spool-rolling": EventKind(
        "info", "the spool has reached its {max_mib} MiB: the oldest frames go from here on", "nothing to do"
    ),
    "spool-low": EventKind(
        "warning",
        "less than {min_free_mib} MiB are free on the disk: the oldest frames go",
        "remove what fills it, or lower [spool] min_free_mib",
    ),
    "spool-full": EventKind(
        "warning", "the disk is full: the oldest frames go", "remove what fills it, or lower [spool] max_mib"
    ),
}
