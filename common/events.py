"""One table of event codes: what it says and what to do. Both sides raise events only from here."""

from dataclasses import dataclass
from typing import Final

from common.messages import Event


@dataclass(frozen=True, slots=True)
class EventKind:
    """Text with {placeholders} filled from the evidence, the cure in one sentence, the level it has."""

    level: str
    text: str
    cure: str


EVENTS: Final[dict[str, EventKind]] = {
    "daemon-started": EventKind("info", "daemon started, {sensors} sensors configured", "nothing to do"),
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
    "clock-stepped": EventKind(
        "warning",
        "UTC of {sensor} jumped by {step_s} s against the boat clock",
        "check the receiver; times on the boat clock are not touched",
    ),
    "frame-failed": EventKind(
        "error", "frame {seq} could not be encoded and was not sent: {reason}", "report this configuration"
    ),
    "ticks-missed": EventKind("warning", "the board slept: {count} frame periods passed at once", "nothing to do"),
    "client-joined": EventKind("info", "client {client} joined", "nothing to do"),
    "client-left": EventKind("info", "client {client} left: {reason}", "nothing to do"),
    "frames-dropped": EventKind(
        "warning", "{count} frames were not sent to client {client}: it reads too slowly", "check the radio link"
    ),
    "frames-missing": EventKind("warning", "{count} frames missing before frame {seq}", "check the radio link"),
    "link-lost": EventKind(
        "warning",
        "no frame from the boat for {age_s} s",
        "check the radio link and the boat's power; the station goes on trying",
    ),
    "link-restored": EventKind("info", "frames arrive again after {age_s} s", "nothing to do"),
    "daemon-restarted": EventKind("warning", "the boat's daemon was restarted; the filters carry on", "nothing to do"),
    "config-changed": EventKind(
        "warning", "the boat came back with another configuration; the filters start anew", "nothing to do"
    ),
    "state-unusable": EventKind(
        "warning", "the start counter cannot be kept: {reason}", "give a writable --state directory"
    ),
    "board-rebooted": EventKind("warning", "the board was rebooted; the filters start anew", "nothing to do"),
    "origin-moved": EventKind(
        "warning",
        "{count} fixes in a row lie more than {limit_km} km from the origin; the filters start anew there",
        "check the receiver if the boat has not been carried away",
    ),
    "filter-started": EventKind("info", "filters start at {lat_deg}, {lon_deg}", "nothing to do"),
    "filter-waiting": EventKind("info", "filters wait for: {missing}", "check these sensors"),
    "filter-aligned": EventKind("info", "filters are aligned: estimates are valid from here on", "nothing to do"),
    "filter-reset": EventKind(
        "error", "filter {filter} gave no finite number and was started again", "report this log"
    ),
    "fix-far": EventKind(
        "warning",
        "fix of {sensor} lies {distance_km} km from the mission's origin and is not used",
        "check the receiver",
    ),
    "late-dropped": EventKind(
        "warning",
        "{count} measurements of {sensor} came more than {limit_s} s late and were not fused",
        "kept in the log: `wayfix replay LOG --order time` puts them in their place",
    ),
    "ahead-dropped": EventKind(
        "warning",
        "{count} measurements of {sensor} are stamped more than {limit_s} s after their own frame and were not fused",
        "check the receiver's time; they are kept in the log",
    ),
    "imu-implausible": EventKind(
        "warning",
        "{count} samples of {sensor} show what no such sensor can measure and were not used",
        "check its cable, its scale and the model in the board's file",
    ),
    "variation-used": EventKind(
        "info",
        "magnetic variation here is {variation_deg} deg (WMM2025, east +, good to {doubt_deg} deg)",
        "nothing to do",
    ),
    "variation-undated": EventKind(
        "warning",
        "the date is unknown: {variation_deg} deg of variation are those of {year}",
        "let the receiver send RMC or ZDA, or set boat.variation_deg in the board's file",
    ),
    "variation-expired": EventKind(
        "warning",
        "the date, {year}, is outside the years of the magnetic model (WMM2025): the variation of {used_year} is used",
        "update Wayfix or set boat.variation_deg in the board's file; if the date is wrong, check the receiver",
    ),
    "compass-weak": EventKind(
        "warning",
        "the earth's horizontal field is only {field_nt} nT here: compass and variation are to be used with caution",
        "near a magnetic pole use a satellite compass or a gyrocompass",
    ),
    "compass-useless": EventKind(
        "warning",
        "the earth's horizontal field is only {field_nt} nT here: compass and variation are unreliable",
        "near a magnetic pole use a satellite compass or a gyrocompass",
    ),
}


NOTHING_TO_DO: Final = "nothing to do"


def line_of(happening: Event) -> str:
    """An event as one line for a person: the text, and the cure where there is something to do."""
    kind = EVENTS.get(happening.code)
    if kind is None or kind.cure == NOTHING_TO_DO:
        return happening.text
    return f"{happening.text}; {kind.cure}"


def event(code: str, t_ns: int, source: str, **evidence: str | float | bool | None) -> Event:
    """Make an event of the table; `evidence` fills the text's placeholders and travels along."""
    kind = EVENTS[code]
    text = kind.text.format(**evidence)[:512]
    return Event(t_ns=t_ns, source=source, code=code, level=kind.level, text=text, evidence=dict(evidence))
