"""Tables as loggers, autopilots and office programs write them, of one known voyage, and what is right of each."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Final

from tests.station.logger_voyage import BEGIN, Table, voyage

ISO = "{t:%Y-%m-%dT%H:%M:%SZ}"
PLACE = "{lat.value:.7f},{lon.value:.7f}"
WAY = "{kn:.3f},{cog:.2f}"


JANUARY = voyage(datetime(2026, 1, 5, 8, 8, tzinfo=UTC))
LATE = voyage(datetime(2026, 5, 22, 15, 8, tzinfo=UTC))
LONG = voyage(rows=120)
FRISCO, AUCKLAND, SINGAPORE = (37.8, -122.4), (-36.84, 174.76), (1.25, 103.8)


def of_place(table: Table, place: tuple[float, float]) -> Table:
    return replace(table, rows=voyage(BEGIN, place))


def tables() -> Iterator[tuple[str, Table]]:
    """Every input with its name."""
    yield from PLACES.items()
    yield from TIMES.items()
    yield from LOGGERS.items()


_SWAPPED = Table("time,lat,lon,sog,cog", f"{ISO},{{lon.value:.6f}},{{lat.value:.6f}},{WAY}")
_DMY = Table("time,lat,lon,sog,cog", f"{{t.day}}/{{t.month}}/{{t.year}} {{t:%H:%M:%S}},{PLACE},{WAY}")

PLACES: Final[dict[str, Table]] = {
    "degrees and minutes in columns": Table(
        "time,lat_deg,lat_min,lon_deg,lon_min,sog,cog",
        ISO + ",{lat.d},{lat.m:.5f},{lon.sign}{lon.d},{lon.m:.5f}," + WAY,
    ),
    "degrees, minutes and letters in columns": Table(
        "Time,Lat Deg,Lat Min,N/S,Lon Deg,Lon Min,E/W,SOG,COG",
        ISO + ",{lat.d},{lat.m:.5f},{lat.h},{lon.d},{lon.m:.5f},{lon.h}," + WAY,
    ),
    "degrees, minutes and seconds in columns": Table(
        "time,lat_d,lat_m,lat_s,lon_d,lon_m,lon_s,sog,cog",
        ISO + ",{lat.d},{lat.mi},{lat.s:.3f},{lon.sign}{lon.d},{lon.mi},{lon.s:.3f}," + WAY,
    ),
    "minutes in a column without a name": Table(
        "Date,Time,Latitude,,Longitude,,SOG,COG",
        "{t:%Y-%m-%d},{t:%H:%M:%S},{lat.d},{lat.m:.5f},{lon.sign}{lon.d},{lon.m:.5f}," + WAY, right="safe",
    ),
    "whole degrees, minutes named apart": Table(
        "UTC,Latitude,LatMinutes,Longitude,LonMinutes,Speed kn,Course",
        ISO + ",{lat.d},{lat.m:.5f},{lon.sign}{lon.d},{lon.m:.5f}," + WAY,
    ),
    "German degrees and minutes": Table(
        "Zeit;Breite Grad;Breite Minuten;Länge Grad;Länge Minuten;Fahrt;Kurs",
        "{t:%d.%m.%Y %H:%M:%S};{lat.d};{lat.m:.4f};{lon.sign}{lon.d};{lon.m:.4f};{kn:.2f};{cog:.1f}",
    ),
    "minus before the minutes of zero degrees": replace(
        Table("time,lat_deg,lat_min,lon_deg,lon_min,sog,cog",
              ISO + ",{lat.d},{lat.m:.5f},{lon.d},{lon.sign}{lon.m:.5f}," + WAY),
        rows=voyage(BEGIN, (51.5, -0.4)),
    ),
    "colons": Table("time,lat,lon,sog,cog", ISO + ",{lat.d}:{lat.mi:02d}:{lat.s:07.4f},"
                    "{lon.sign}{lon.d}:{lon.mi:02d}:{lon.s:07.4f}," + WAY),
    "blanks": Table("time,lat,lon,sog,cog", ISO + ",{lat.d} {lat.mi:02d} {lat.s:07.4f},"
                    "{lon.sign}{lon.d} {lon.mi:02d} {lon.s:07.4f}," + WAY),
    "degree signs": Table("time,lat,lon,sog,cog", ISO + ",{lat.d}°{lat.mi:02d}'{lat.s:06.3f}\"N,"
                          "{lon.d}°{lon.mi:02d}'{lon.s:06.3f}\"W," + WAY),
    "colons with letters in one cell": Table("time;position;sog;cog", ISO + ";{lat.d}:{lat.m:07.4f}N "
                                             "{lon.d}:{lon.m:07.4f}W;{kn:.3f};{cog:.2f}"),
    "scientific numbers": Table("time,lat,lon,sog,cog", ISO + ",{lat.value:.9E},{lon.value:.9E}," + WAY),
    "scientific numbers, too coarse": Table("time,lat,lon", ISO + ",{lat.value:.1E},{lon.value:.1E}",
                                            right="refused"),
    "swapped names, San Francisco": of_place(replace(_SWAPPED, right="read"), FRISCO),
    "swapped names, Auckland": of_place(_SWAPPED, AUCKLAND),
    "swapped names, both fit, with a course": replace(_SWAPPED, rows=voyage(BEGIN, cog=110.0)),
    "swapped names, no course": replace(of_place(_SWAPPED, FRISCO), head="time,lat,lon",
                                        row=f"{ISO},{{lon.value:.6f}},{{lat.value:.6f}}", parts="fix", right="safe"),
    "x and y of a map": Table("X,Y,fid,track_fid,time,speed", "{lon.value:.7f},{lat.value:.7f},{k},0," + ISO
                              + ",{m_s:.3f}", parts="fix sog"),
    "a point of WKT": Table("WKT,time", "POINT ({lon.value:.7f} {lat.value:.7f})," + ISO, parts="fix"),
    "plain degrees near Singapore": of_place(Table("time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}"), SINGAPORE),
    "0 to 360": Table("time,lat,lon,sog,cog", ISO + ",{lat.value:.7f},{lon360:.7f}," + WAY),
    "letters before": Table("time,lat,lon,sog,cog", ISO + ",{lat.h}{lat.abs:.6f},{lon.h}{lon.abs:.6f}," + WAY),
    "ddmm.mmmm with signs": Table("time,lat,lon,sog,cog", ISO + ",{lat.packed:.4f},{lon.sign}{lon.packed:.4f}," + WAY),
    "1e-7 degrees": Table("time,lat,lon,sog,cog", ISO + ",{lat.e7},{lon.e7}," + WAY),
    "radians": Table("time,lat [rad],lon [rad],sog,cog", ISO + ",{lat.rad:.9f},{lon.rad:.9f}," + WAY),
    "radians without a word": Table("time,latitude,longitude,sog,cog", ISO + ",{lat.rad:.9f},{lon.rad:.9f}," + WAY,
                                    right="safe"),
    "west is positive by its name": Table("time,Lat N,Lon W,sog,cog", ISO + ",{lat.abs:.6f},{lon.abs:.6f}," + WAY),
    "west is positive, a course says so": Table("time,lat,lon,sog,cog", ISO + ",{lat.abs:.6f},{lon.abs:.6f}," + WAY),
    "VBOX": Table(
        "File created on 12/05/2026 at 10:08:00\n\n[header]\nsatellites\ntime\nlatitude\nlongitude\nvelocity kmh\n"
        "heading\nheight\n\n[column names]\nsats time lat long velocity heading height\n\n[data]",
        "009 {hms}.00 +{lat.minutes:010.5f} +{west_minutes:011.5f} {kmh:07.3f} {cog:06.2f} +00004.20", has_utc=False,
    ),
    "thousands in a counter": Table("time_ms,lat,lon,sog,cog", '"{ms:,}",' + PLACE + "," + WAY, has_utc=False),
    "thousands in a place": Table("time;lat;lon", ISO + ";{lat.packed:,.4f};{lon.sign}{lon.packed:,.4f}", parts="fix"),
    "UTF-16 without a mark": Table("time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}", encoding="utf-16-le"),
    "UTF-16 of Excel": Table("time\tlat\tlon\tsog\tcog", f"{ISO},{PLACE},{WAY}".replace(",", "\t"), encoding="utf-16"),
    "two heads": Table("time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}",
                       order=lambda lines: [*lines[:20], "time,lat,lon,sog,cog", *lines[20:]]),
    "two heads, another order": Table(
        "time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}",
        order=lambda lines: [*lines[:30], "time,sog,cog,lat,lon",
                             *(f"{a},{d},{e},{b},{c}" for a, b, c, d, e in (x.split(",") for x in lines[30:]))],
    ),
    "two heads, other names": Table(
        "time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}", right="refused",
        order=lambda lines: [*lines[:20], "Date,Speed,Course,Breite,Laenge",
                             *(f"{a},{d},{e},{b},{c}" for a, b, c, d, e in (x.split(",") for x in lines[20:]))],
    ),
    "cat b a": Table("time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}", order=lambda lines: lines[30:] + lines[:30]),
    "shuffled": Table("time,lat,lon,sog,cog", f"{ISO},{PLACE},{WAY}",
                      order=lambda lines: [lines[k * 29 % 48] for k in range(48)]),
    "shuffled counter": Table("millis,lat,lon,sog,cog", "{k}000," + PLACE + "," + WAY, has_utc=False,
                              order=lambda lines: [lines[k * 29 % 48] for k in range(48)]),
    "JSON lines": Table("", '{{"time":"' + ISO + '","pos":{{"lat":{lat.value:.7f},"lon":{lon.value:.7f}}},'
                        '"sog":{kn:.3f},"cog":{cog:.2f}}}', right="refused"),
    "a JSON array": Table("", '{{"ts":{unix}000,"latitude":{lat.value:.7f},"longitude":{lon.value:.7f},"speed_kn":'
                          '{kn:.3f},"course":{cog:.2f}}}', right="refused",
                          order=lambda lines: ["[" + ",\n".join(lines) + "]"]),
}  # fmt: skip

_EATEN = Table("date,time,lat,lon,sog,cog", "{dmy},{hms},{lat.packed:.4f},{lon.sign}{lon.packed:.4f}," + WAY)


def timed(name: str, form: str, **more: object) -> Table:
    """A table with one column of time."""
    return replace(Table(f"{name},lat,lon,sog,cog", f"{form},{PLACE},{WAY}"), **more)  # type: ignore[arg-type]


TIMES: Final[dict[str, Table]] = {
    "UTC beside local": timed("Local Time,UTC", "{lt:%Y-%m-%d %H:%M:%S},{t:%Y-%m-%d %H:%M:%S}"),
    "UTC behind time": timed("time,utc", "{lt:%d.%m.%Y %H:%M:%S},{t:%d.%m.%Y %H:%M:%S}"),
    "UTC of day beside a local date and time": timed("Date,Time,UTC", "{lt:%Y-%m-%d},{lt:%H:%M:%S},{t:%H:%M:%S}"),
    "UTC of day on the day before the local date": timed(
        "Date,Time,UTC", "{lt:%Y-%m-%d},{lt:%H:%M:%S},{t:%H:%M:%S}",
        rows=voyage(datetime(2026, 5, 12, 22, 30, tzinfo=UTC)), right="safe",
    ),
    "local and UTC dates and times": timed("Date (local),Time (local),Date (UTC),Time (UTC)",
                                           "{lt:%d/%m/%Y},{lt:%H:%M:%S},{t:%d/%m/%Y},{t:%H:%M:%S}", rows=LATE),
    "a zone in the cell": timed("time", "{lt:%Y-%m-%d %H:%M:%S}+02:00"),
    "local alone": timed("local_time", "{lt:%Y-%m-%d %H:%M:%S}", has_utc=False),
    "Excel day and fraction": timed("Date,Time", "{excel0},{frac:.9f}"),
    "Excel fraction and day": timed("Time,Date", "{frac:.9f},{excel0}"),
    "Excel day": timed("Date", "{excel:.9f}"),
    "Excel day with a comma": Table("Datum;Breite;Länge", "{excel:.9f};{lat.value:.7f};{lon.value:.7f}", parts="fix"),
    "DDMMYY without its zero": replace(_EATEN, rows=JANUARY),
    "DDMMYY without its zero, the tenth digit": replace(_EATEN, rows=voyage(datetime(2026, 12, 1, 8, 8, tzinfo=UTC))),
    "HHMMSS without its zeros": replace(
        _EATEN, row=_EATEN.row.replace("{hms}", "{hms_int}"), rows=voyage(datetime(2026, 1, 5, 0, 0, 1, tzinfo=UTC))
    ),
    "DDMMYY beside plain degrees": Table("date,time,lat,lon,sog,cog", "{dmy:06d},{hms}," + PLACE + "," + WAY),
    "DDMMYY beside a clock with colons": timed("date,time", "{dmy:06d},{t:%H:%M:%S}", right="safe"),
    "YYMMDD": timed("yymmdd,hhmmss", "{t:%y%m%d},{hms}"),
    "TinyGPS": timed("date,time", "{dmy:06d},{hms}00"),
    "compact ISO": timed("time", "{t:%Y%m%dT%H%M%SZ}"),
    "fourteen digits": timed("timestamp", "{t:%Y%m%d%H%M%S}"),
    "seventeen digits": timed("timestamp", "{t:%Y%m%d%H%M%S}000"),
    "ISO without seconds": timed("time", "{t:%Y-%m-%dT%H:%MZ}", right="safe", parts="fix"),
    "ISO with nanoseconds": timed("time", "{t:%Y-%m-%dT%H:%M:%S}.000000000Z"),
    "year, month, day, hour, minute, second": timed(
        "year,month,day,hour,min,sec", "{t.year},{t.month},{t.day},{t.hour},{t.minute},{t.second}"
    ),
    "ctime": timed("time", "{t:%a %b %d %H:%M:%S %Y}"),
    "English month": timed("time", "{t:%d-%b-%Y %H:%M:%S}"),
    "German month": timed("Zeit", "{t.day}. Mai 2026 {t:%H:%M:%S}"),
    "German month, short": timed("Datum,Uhrzeit", "12.Okt.2026,{t:%H:%M:%S}",
                                 rows=voyage(datetime(2026, 10, 12, 10, 8, tzinfo=UTC))),
    "French month": timed("heure", "12 août 2026 {t:%H:%M:%S}", rows=voyage(datetime(2026, 8, 12, 10, 8, tzinfo=UTC))),
    "Spanish month": timed("fecha", "12-dic-2026 {t:%H:%M:%S}", rows=voyage(datetime(2026, 12, 12, 10, 8, tzinfo=UTC))),
    "French month, cp1252": timed("heure", "12 févr. 2026 {t:%H:%M:%S}", encoding="cp1252",
                                  rows=voyage(datetime(2026, 2, 12, 10, 8, tzinfo=UTC))),
    "day or month, 24 hours": replace(_DMY, right="asked"),
    "day first, the 22nd": replace(_DMY, rows=LATE),
    "AM and PM, day or month": timed("time", "{t:%m/%d/%Y %I:%M:%S %p}", right="asked"),
    "AM and PM, an Australian": timed("time", "{t.day}/{t:%m/%Y %I:%M:%S %p}", right="asked",
                                      rows=voyage(datetime(2026, 5, 6, 10, 8, tzinfo=UTC))),
    "AM and PM, the 22nd": timed("time", "{t:%m/%d/%Y %I:%M:%S %p}", rows=LATE),
    "AM and PM beside an ISO date": timed("time,day", "{t:%m/%d/%Y %I:%M:%S %p},{t:%Y-%m-%d}", right="safe"),
    "AM and PM of miles and feet": timed("Time,Speed (mph),Altitude (ft)", "{t:%m/%d/%Y %I:%M:%S %p},{mph:.3f},12.0",
                                         right="safe"),
    "over midnight of a month": timed("time", "{t:%m/%d/%Y %I:%M:%S %p}",
                                      rows=voyage(datetime(2026, 5, 12, 23, 59, 40, tzinfo=UTC))),
    "epoch in s": timed("time", "{unix}"),
    "epoch in s with decimals": timed("timestamp", "{unix}.000"),
    "epoch in ms": timed("timestamp", "{unix}000"),
    "epoch in us": timed("time_us", "{unix}000000"),
    "epoch in ns": timed("stamp", "{unix}000000000"),
    "epoch in ms that a spreadsheet rounded": timed("timestamp", "1.77858E+12", right="refused"),
    "epoch of 1904": timed("time", "{since_1904}", right="refused"),
    "epoch of 2001": timed("timestamp", "{since_2001}", right="safe"),
    "GPS seconds": timed("gps_seconds", "{gps}"),
    "GPS seconds called gps_time": timed("gps_time", "{gps}", right="asked"),
    "GPS week and time of week": timed("gps_week,gps_tow", "{week},{tow}.00"),
    "time of week alone": timed("iTOW", "{tow}000", has_utc=False),
    "MATLAB datenum": timed("datenum", "{matlab:.9f}"),
    "Julian day": timed("JD", "{julian:.9f}", right="safe"),
    "time of day": timed("time", "{t:%H:%M:%S}.00", has_utc=False),
    "time of day over noon, 12 hours": timed("time", "{t:%I:%M:%S %p}", has_utc=False,
                                             rows=voyage(datetime(2026, 5, 12, 11, 59, 40, tzinfo=UTC))),
    "seconds since the start": timed("elapsed [s]", "{k}.0", has_utc=False),
    "minutes and seconds": timed("elapsed", "{mmss}", has_utc=False, right="safe"),
    "R POSIXct": timed('"","time"', '"{k}",{t:%Y-%m-%d %H:%M:%S}'),
    "pandas index": timed(",time", "{k},{t:%Y-%m-%d %H:%M:%S}+00:00"),
    "pandas index of times": timed("", "{t:%Y-%m-%d %H:%M:%S}"),
    "a sequence number called t": timed("t,time", "{k},{t:%Y-%m-%dT%H:%M:%SZ}"),
}  # fmt: skip

LOGGERS: Final[dict[str, Table]] = {
    "ArduPilot GPS": Table(
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        "{ms}000,0,3,{tow}000,{week},12,0.8," + PLACE + ",4.2,{m_s:.3f},{cog:.2f},0,0,1",
    ),
    "ArduPilot MAVLink": Table(
        "timestamp,time_boot_ms,lat,lon,alt,relative_alt,vx,vy,vz,hdg",
        ISO + ",{ms},{lat.e7},{lon.e7},4200,0,{vn:.0f},{ve:.0f},0,{cdeg}", parts="fix heading",
    ),
    "PX4": Table(
        "timestamp,time_utc_usec,lat,lon,alt,vel_m_s,vel_n_m_s,vel_e_m_s,cog_rad,fix_type",
        "{ms}000,{unix}000000,{lat.e7},{lon.e7},4200,{m_s:.3f},{vn:.3f},{ve:.3f},{rad:.5f},3",
    ),
    "PX4 attitude": Table(
        "timestamp,latitude_deg,longitude_deg,q[0],q[1],q[2],q[3]",
        "{ms}000," + PLACE + ",{qw:.7f},0,0,{qz:.7f}", parts="fix heading", has_utc=False,
    ),
    "u-center": Table("Index;UTC;iTOW [s];Lat [deg];Lon [deg];Alt (MSL) [m];Speed [m/s];Heading [deg]",
                      "{k};{t:%H:%M:%S}.00;{tow};{lat.value:.7f};{lon.value:.7f};4.2;{m_s:.3f};{cog:.2f}",
                      parts="fix sog", has_utc=False),
    "u-blox PVT": Table("iTOW,year,month,day,hour,min,second,lon,lat,hMSL,gSpeed,headMot",
                        "{tow}000,{t.year},{t.month},{t.day},{t.hour},{t.minute},{t.second},{lon.e7},{lat.e7},4200,"
                        "{m_s:.3f},{cog:.2f}", parts="fix sog cog"),
    "QGroundControl": Table("Timestamp,heading,groundSpeed,gps.lat,gps.lon,gps.courseOverGround,yawRate",
                            "{t:%Y-%m-%d %H:%M:%S}.000,{cog:.2f},{m_s:.3f}," + PLACE + ",{cog:.2f},{rate:.3f}",
                            parts="fix sog cog heading imu"),
    "Garmin": Table("Header\tPosition\tTime\tAltitude",
                    "Trackpoint\tN{lat.d} {lat.m:.4f} W{lon.d} {lon.m:.4f}\t{t.month}/{t.day}/{t:%Y %I:%M:%S %p}\t4 m",
                    parts="fix", rows=LATE),
    "Garmin FIT": Table("timestamp,position_lat,position_long,speed,heading",
                        "{fit},{lat.semi},{lon.semi},{m_s:.3f},{cog:.2f}", parts="fix sog", right="safe"),
    "Garmin FIT with units": Table("timestamp [s],position_lat [semicircles],position_long [semicircles],speed [m/s]",
                                   "{fit},{lat.semi},{lon.semi},{m_s:.3f}", parts="fix sog", right="safe"),
    "Expedition": Table("Boat,Utc,BSP,AWA,AWS,TWA,TWS,TWD,HDG,Lat,Lon,COG,SOG",
                        "0,{excel:.8f},4.5,31.2,13.7,48.0,9.5,300.0,{cog:.1f}," + PLACE + ",{cog:.2f},{kn:.3f}"),
    "Expedition, sparse": Table(
        "!Boat,Utc,BSP,AWA,AWS,TWA,TWS,Lat,Lon,COG,SOG\n!boat,0,1,2,3,4,5,48,49,50,51\n!v12.5.1",
        "0,{excel:.8f},1,6.81,48,{lat.value:.6f},49,{lon.value:.6f},50,{cog:.2f}", right="refused",
    ),
    "Expedition, sparse with holes": Table(
        "!Boat,Utc,BSP,AWA,Lat,Lon,SOG\n!boat,0,1,2,48,49,51\n!v12.5.1",
        "0,{excel:.8f},48,{lat.value:.6f},49,{lon.value:.6f}", right="refused",
    ),
    "Vakaros": Table("timestamp,latitude,longitude,sog_kts,cog,hdg_true,heel,trim",
                     "{lt:%Y-%m-%dT%H:%M:%S}.000+0200," + PLACE + ",{kn:.3f},{cog:.2f},{cog:.2f},1.5,0.3",
                     parts="fix sog cog heading"),
    "Velocitek": Table("Time,Heading,Speed,Latitude,Longitude",
                       "{lt:%Y-%m-%dT%H:%M:%S}+02:00,{cog:.2f},{kn:.3f}," + PLACE, parts="fix sog heading"),
    "RaceRender": Table("Time,GPS Time,Longitude,Latitude,Altitude,X,Y,MPH",
                        "{k}.0,{ms},{lon.value:.7f},{lat.value:.7f},4.2,0.0,0.0,{mph:.3f}", parts="fix sog",
                        has_utc=False),
    "RTKLIB in GPS time": Table(
        "% program   : RTKPOST ver.2.4.3\n% obs start : 2026/05/12 10:08:18.0 GPST (week2418 209298.0s)\n%\n"
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
        "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)",
        "{gt:%Y/%m/%d %H:%M:%S}.000   {lat.value:.9f}   {lon.value:.9f}   182.7826   5   9   2.1245   1.9103   3.7333",
        parts="fix",
    ),
    "RTKLIB in UTC": Table(
        "% program   : RTKPOST ver.2.4.3\n%  UTC                   latitude(deg) longitude(deg)  height(m)   Q  ns",
        "{t:%Y/%m/%d %H:%M:%S}.000   {lat.value:.9f}   {lon.value:.9f}   182.7826   5   9", parts="fix",
    ),
    "RTKLIB in weeks": Table(
        "% program   : RTKPOST ver.2.4.3\n%  GPST          latitude(deg) longitude(deg)  height(m)   Q  ns",
        "{week} {tow}.000   {lat.value:.9f}   {lon.value:.9f}   182.7826   5   9", parts="fix",
    ),
    "ROS bag": Table(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.status.status,field.latitude,"
        "field.longitude,field.altitude,field.position_covariance0",
        "{unix}000000000,{k},{unix}000000000,gps,0," + PLACE + ",4.2,0.5", parts="fix",
    ),
    "ROS stamps and a quaternion": Table(
        "header.stamp.secs,header.stamp.nsecs,latitude,longitude,orientation.x,orientation.y,orientation.z,"
        "orientation.w", "{unix},0," + PLACE + ",0,0,{rz:.7f},{rw:.7f}", parts="fix heading", rows=LONG,
    ),
    "NMEA in a table": Table("Date,UTC,Status,Latitude,N/S,Longitude,E/W,Speed,Course,HDOP",
                             "{dmy:06d},{hms}.00,A,{lat.packed:.4f},{lat.h},{lon.packed:010.4f},{lon.h}," + WAY
                             + ",0.8"),
    "Signal K logger": Table("timestamp,latitude,longitude,SOG,COG,STW,AWS,AWA", ISO + f",{PLACE},{WAY},4.5,13.7,31.2"),
    "a balloon of Arduino": Table("millis,gps_time,lat,lon,alt,speed,course", "{ms},{hms}00,{lat.e6},{lon.e6},420,"
                                  "{ckn},{cdeg}", has_utc=False, right="safe"),
    "heading in rad": Table("time,lat,lon,heading", ISO + f",{PLACE},{{rad:.4f}}", parts="fix heading"),
    "heading counted from east": Table("time,lat,lon,yaw", ISO + f",{PLACE},{{enu:.2f}}", parts="fix heading",
                                       rows=LONG),
    "heading of a unit mounted backwards": Table("time,lat,lon,heading", ISO + f",{PLACE},{{back:.2f}}",
                                                 parts="fix", right="safe"),
    "heading 0 beside a course": Table("time,lat,lon,cog,heading", ISO + f",{PLACE},{{cog:.2f}},0.0", parts="fix cog"),
    "straight, heading from east": Table("time,lat,lon,yaw", ISO + f",{PLACE},{{enu:.2f}}", parts="fix",
                                         rows=voyage(BEGIN, cog=130.0, turn=False)),
    "straight, heading in rad": Table("time,lat,lon,heading", ISO + f",{PLACE},{{rad:.4f}}", parts="fix",
                                      rows=voyage(BEGIN, cog=130.0, turn=False)),
    "speed in m/s without a unit": Table("time,lat,lon,speed,course", ISO + f",{PLACE},{{m_s:.3f}},{{cog:.2f}}"),
    "speed in km/h without a unit": Table("time,lat,lon,speed,course", ISO + f",{PLACE},{{kmh:.3f}},{{cog:.2f}}"),
}  # fmt: skip
