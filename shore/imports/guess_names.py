"""Column names of loggers in several languages, by what they mean (schema matching by name)."""

import re
from collections.abc import Sequence
from typing import Final

_CAMEL: Final = re.compile(r"(?<=[a-zäöü])(?=[A-Z][a-zäöü])|(?<=[a-z])(?=[A-Z]\b)")
_NO_WORD: Final = re.compile(r"[^a-z0-9äöüéèíóßµ]+")
_BRACKETED: Final = re.compile(r"[(\[{][^)\]}]*[)\]}]")

NAMES: Final[dict[str, str]] = {
    "time": r"date|datum|fecha|utc|gmt|datetime|date ?time|timestamp|time ?stamp|time|zeit|uhrzeit|zeitstempel|heure|"
    r"hora|"
    r"time ?us|time ?ms|time s|millis|micros|epoch|unix|unixtime|t|sec|seconds|elapsed|tow|original timestamp|"
    r"header stamp secs|"
    r"(time )?unix|unix time|time ?boot ?ms|time ?unix ?usec|"
    r"(gps |utc |local |gnss )?(date|time)( utc| gmt| local| iso)?",
    "lat": r"lat|latitude|breite|breitengrad|geograph\w* breite|latitud|lat ?deg|lattitude",
    "lon": r"lon|lng|long|longitude|länge|laenge|längengrad|laengengrad|geograph\w* länge|longitud|lon ?deg|long deg",
    "place": r"position|coordinates?|coords?|lat ?lon|lat ?long|location|latitude longitude",
    "sog": r"sog|speed|spd|gps speed|gspeed|g ?speed|ground ?speed|speed over ground|fahrt|fahrt über grund|"
    r"geschwindigkeit|"
    r"vitesse|velocidad|velocity|vel|speed 2d|horizontal speed|knots|kts|kn|kmh|kph|mph",
    "cog": r"cog|course|crs|gcrs|g ?crs|track|track true|course over ground|ground ?course|kurs|kurs über grund|"
    r"rumbo|route|course true|heading ?motion|head ?mot|bearing",
    "heading": r"heading|hdg|hdt|hdm|yaw|compass|kompass|compass heading|magnetic heading|true heading|heading true|"
    r"heading magnetic|heading mag|steuerkurs|cap|psi|azimuth|yaw ?u|euler ?z|heading yaw",
    "yaw_rate": r"yaw ?rate|rate of turn|rot|turn ?rate|yaw ?speed|gyro? ?z|gyr ?z|g ?z|w ?z|omega ?z|gyroscope ?z|"
    r"angular velocity z|"
    r"angular ?rate ?z|drehrate|psi dot|heading ?rate|r",
    "accel_fwd": r"(linear )?acc(el|eleration|elerometer)? ?x|a ?x|surge dot|acc(el)? ?(fwd|forward)|a fwd",
    "accel_stb": r"(linear )?acc(el|eleration|elerometer)? ?y|a ?y|sway dot|acc(el)? ?(stb|starboard)|a stb",
    "alt": r"alt|altitude|height|höhe|hoehe|elevation|ele|hmsl|msl|alt ?msl|amsl|altitude ?amsl|altitud|hauteur",
}
"""Whole names (in small letters, words parted by blanks, without units and prefixes) of each role."""
_PREFIXES: Final = re.compile(
    r"^(gps|gnss|imu|ins|ekf|nav|navigation|vehicle|global position|attitude|vfr hud|gps1|imu1|nmea|rmc|gga|"
    r"mavlink [a-z0-9 ]*? t)\s+"
)
_UNIT_WORDS: Final = re.compile(
    r"\s+(deg|degrees|rad|kn|kts|knots|kmh|km h|mph|m s|mps|ms|m|ft|g|dps|deg s|rad s|m s2|mps2|s|us|e7|cm s|true)$"
)
_OTHERS: Final = re.compile(
    r"\b(wind|water|stw|acc(uracy)?|std|sigma|cov\w*|error|err|rate|dot|target|desired|setpoint|sp|des|var\w*|"
    r"depth|temp\w*|vertical|climb|age|delay|mag [xyz])\b"
)
_RATES: Final = ("yaw_rate", "accel_fwd", "accel_stb")


def plain(name: str) -> str:
    """A name in small letters, its words parted by blanks, without what stands in brackets."""
    return _NO_WORD.sub(" ", _CAMEL.sub(" ", _BRACKETED.sub(" ", name)).casefold()).strip()


def candidates(columns: Sequence[str], role: str) -> list[str]:
    """The columns whose name is one of a role, the likeliest first."""
    pattern = re.compile(NAMES[role])
    found = []
    for place, column in enumerate(columns):
        text = plain(column)
        if role not in _RATES and _OTHERS.search(text):
            continue
        for rank, form in enumerate(_forms(text)):
            if pattern.fullmatch(form):
                found.append((rank, place, column))
                break
    return [column for _, _, column in sorted(found)]


def _forms(text: str) -> list[str]:
    """The name as it is, without its unit, without its prefixes, and its last words."""
    forms = [text, _UNIT_WORDS.sub("", text)]
    while (shorter := _PREFIXES.sub("", forms[-1])) != forms[-1]:
        forms += [shorter]
    words = forms[1].split()
    return [*dict.fromkeys([*forms, *(" ".join(words[-count:]) for count in (3, 2, 1) if _is_longer(words, count))])]


def _is_longer(words: Sequence[str], count: int) -> bool:
    """True when the last `count` words may be the name and the others a prefix: single letters are no name then."""
    return len(words) > count and (count > 1 or len(words[-1]) > 2)
