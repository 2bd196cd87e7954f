"""Column names of loggers in several languages, by what they mean (schema matching by name)."""

import re
from collections.abc import Sequence
from typing import Final

_CAMEL: Final = re.compile(r"(?<=[a-zäöü])(?=[A-Z][a-zäöü])|(?<=[a-z])(?=[A-Z]\b)")
_NO_WORD: Final = re.compile(r"[^a-z0-9äöüéèíóßµ]+")
_BRACKETED: Final = re.compile(r"[(\[{](?![0-9][)\]}])[^)\]}]*[)\]}]")
"""What stands in brackets; an index (`q[0]`) is part of the name."""


_LAT: Final = r"(lat|lati?titude|latitude|lattitude|breite|breitengrad|geograph\w* breite|latitud|y lat)"
_LON: Final = (
    r"(lon|lng|long|longitude|länge|laenge|längengrad|laengengrad|geograph\w* länge|longitud|x lon|position long)"
)
_DEG: Final = r"( ?(d|dd|deg|degs|degrees?|grad|grados|degrés))?"
_MIN: Final = r" ?(m|mm|min|mins|minutes?|minuten|minutos)( dec(imal)?)?"
_SEC: Final = r" ?(s|ss|sec|secs|seconds?|sekunden|segundos|secondes)"
NAMES: Final[dict[str, str]] = {
    "time": (
        r"date|datum|fecha|utc|gmt|datetime|date ?time|timestamp|time ?stamp|time|zeit|uhrzeit|zeitstempel|heure|hora|"
        r"stamp|ts|recorded ?at|created ?at|datenum|jd|mjd|julian( day| date)?|"
        r"time ?us|time ?ms|time s|time ns|millis|micros|nanos|epoch( ms| us| ns)?|unix|unix ?time|t|sec|secs|seconds|"
        r"elapsed( time)?|i?tow|gps tow|original timestamp|header stamp secs?|header stamp|stamp secs?|"
        r"(time )?unix|unix time|time ?boot ?ms|time ?unix ?usec|time ?utc ?usec|gpst|gpst time|gps ?(s|sec|seconds)|"
        r"(ddmmyy|yymmdd|mmddyy|yyyymmdd|hhmmss(ss|cc)?|hhmm)|date ?(ddmmyy|yymmdd|mmddyy)|day|"
        r"(gps |utc |local |gnss |boat |ship |ortszeit )?(date|time|datum|zeit|datetime|date ?time|timestamp)"
        r"( utc| gmt| local| iso| lt| lmt| gps)?|utc ?(date|time|datetime)|local|local ?time|ortszeit|heure locale|"
        r"hora local|heure utc|hora utc|date utc|fecha utc|zeit utc"
    ),
    "lat": f"{_LAT}{_DEG}|{_LAT} (n|s|north|south)|position lat|lat ?e ?7",
    "lon": f"{_LON}{_DEG}|{_LON} (e|w|east|west)|long deg|lon ?e ?7|lng ?e ?7",
    "lat_min": _LAT + _MIN,
    "lon_min": _LON + _MIN,
    "lat_sec": _LAT + _SEC,
    "lon_sec": _LON + _SEC,
    "place": (
        r"position|pos|coordinates?|coords?|lat ?lon|lat ?long|lat ?lng|location|latitude longitude|wkt|geom|geometry|"
        r"posici[oó]n|the geom|wkt geom"
    ),
    "sog": (
        r"sog|speed|spd|gps speed|gspeed|g ?speed|ground ?speed|speed over ground|fahrt|fahrt über grund|"
        r"geschwindigkeit|vel m s|gps ?spd|"
        r"vitesse|velocidad|velocity|vel|speed 2d|horizontal speed|knots|kts|kn|kmh|kph|mph"
    ),
    "cog": (
        r"cog|course|crs|gcrs|g ?crs|track|track true|course over ground|ground ?course|kurs|kurs über grund|"
        r"rumbo|route|course true|heading ?motion|head ?mot|bearing"
    ),
    "heading": (
        r"heading|hdg|hdt|hdm|yaw|compass|kompass|compass heading|magnetic heading|true heading|heading true|"
        r"heading magnetic|heading mag|steuerkurs|cap|psi|azimuth|yaw ?u|euler ?z|heading yaw"
    ),
    "yaw_rate": (
        r"yaw ?rate|rate of turn|rot|turn ?rate|yaw ?speed|gyro? ?z|gyr ?z|g ?z|w ?z|omega ?z|gyroscope ?z|"
        r"angular velocity z|angular ?rate ?z|drehrate|psi dot|heading ?rate|r"
    ),
    "accel_fwd": (r"(linear )?acc(el|eleration|elerometer)? ?x|a ?x|surge dot|acc(el)? ?(fwd|forward)|a fwd"),
    "accel_stb": (r"(linear )?acc(el|eleration|elerometer)? ?y|a ?y|sway dot|acc(el)? ?(stb|starboard)|a stb"),
    "alt": (r"alt|altitude|height|höhe|hoehe|elevation|ele|hmsl|msl|alt ?msl|amsl|altitude ?amsl|altitud|hauteur"),
    "week": r"week|gps ?week|gwk|week ?no|wn|week number",
    "tow": r"i?tow|gps ?tow|gms|time ?of ?week|tow ?m?s|sow|gps ?sow|seconds of week",
    "year": r"year|yyyy|yy|jahr|año|ano|année|annee",
    "month": r"month|mon|mm|mo|monat|mes|mois",
    "day": r"day|dd|tag|día|dia|jour",
    "hour": r"hours?|hh|hr|stunde|hora|heure",
    "minute": r"minutes?|min|mi|minuto",
    "second": r"seconds?|sec|ss|sekunde|segundo|seconde",
    "quat_x": r"(orientation|quaternion|quat|q) ?x|q ?1",
    "quat_y": r"(orientation|quaternion|quat|q) ?y|q ?2",
    "quat_z": r"(orientation|quaternion|quat|q) ?z|q ?3",
    "quat_w": r"(orientation|quaternion|quat|q) ?w|q ?0",
    "map_x": r"x",
    "map_y": r"y",
}
"""Whole names (in small letters, words parted by blanks, without units and prefixes) of each role."""
_PREFIXES: Final = re.compile(
    r"^(gps|gnss|imu|ins|ekf|nav|navigation|vehicle|global position|attitude|vfr hud|gps1|imu1|nmea|rmc|gga|field|pos|"
    r"mavlink [a-z0-9 ]*? t)\s+"
)
_UNIT_WORDS: Final = re.compile(
    r"\s+(deg|degrees|rad|kn|kts|knots|kmh|km h|mph|m s|mps|ms|m|ft|g|dps|deg s|rad s|m s2|mps2|s|us|e7|cm s|true)$"
)
_OTHERS: Final = re.compile(
    r"\b(wind|water|stw|acc(uracy)?|std|sigma|cov\w*|error|err|rate|dot|target|desired|setpoint|sp|des|var\w*|"
    r"depth|temp\w*|vertical|climb|age|delay|mag [xyz]|port lat|stbd lat|waypoint|wp)\b"
)
_WITH_OTHERS: Final = ("yaw_rate", "accel_fwd", "accel_stb")
_WHOLE: Final = ("week", "tow", "year", "month", "day", "hour", "minute", "second", "map_x", "map_y", "lat_min",
                 "lon_min", "lat_sec", "lon_sec")  # fmt: skip
"""Roles whose names are too short to be the last word of another name."""
_UTC: Final = frozenset(("utc", "gmt", "zulu"))
_LOCAL: Final = frozenset((
    "local", "lt", "lmt", "ortszeit", "locale", "cet", "cest", "mez", "mesz", "est", "edt", "pst", "pdt", "bst", "boat",
    "ship", "lokal",
))  # fmt: skip
_NO_UTC: Final = frozenset(("gpst", "tai"))


def plain(name: str) -> str:
    """A name in small letters, its words parted by blanks, without what stands in brackets."""
    return _NO_WORD.sub(" ", _CAMEL.sub(" ", _BRACKETED.sub(" ", name)).casefold()).strip()


def candidates(columns: Sequence[str], role: str) -> list[str]:
    """The columns whose name is one of a role, the likeliest first."""
    pattern = re.compile(NAMES[role])
    found = []
    for place, column in enumerate(columns):
        text = plain(column)
        if role not in _WITH_OTHERS and _OTHERS.search(text):
            continue
        for rank, form in enumerate(_forms(text, is_whole=role in _WHOLE)):
            if pattern.fullmatch(form):
                found.append((rank, place, column))
                break
    return [column for _, _, column in sorted(found)]


def utc_word(column: str) -> int:
    """What a name says of its clock: 1 = UTC, -1 = local time, -2 = GPS time, 0 = nothing."""
    words = set(_NO_WORD.sub(" ", _CAMEL.sub(" ", column).casefold()).split())
    if words & _UTC:
        return 1
    if words & _NO_UTC:
        return -2
    return -1 if words & _LOCAL else 0


def is_other(column: str) -> bool:
    """True when a name is one of another kind than time."""
    return any(column in candidates([column], role) for role in ("lat", "lon", "sog", "cog", "heading", "alt"))


def _forms(text: str, *, is_whole: bool) -> list[str]:
    """The name as it is, without its unit, without its prefixes, and its last words."""
    forms = [text, *([] if is_whole else [_UNIT_WORDS.sub("", text)])]
    while (shorter := _PREFIXES.sub("", forms[-1])) != forms[-1]:
        forms += [shorter]
    if is_whole:
        return list(dict.fromkeys(forms))
    words = forms[1].split()
    return [*dict.fromkeys([*forms, *(" ".join(words[-count:]) for count in (3, 2, 1) if _is_longer(words, count))])]


def _is_longer(words: Sequence[str], count: int) -> bool:
    """True when the last `count` words may be the name and the others a prefix: single letters are no name then."""
    return len(words) > count and (count > 1 or len(words[-1]) > 2)
