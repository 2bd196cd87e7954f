"""The local plane against pyproj's topocentric transform, and there and back."""

import math
import random

import pytest
from pyproj import Geod, Transformer

from common.geodesy import LocalPlane

ORIGINS = [
    (0.0, 0.0),
    (50.3, -4.1),
    (-33.9, 151.2),
    (59.99, 10.0),
    (60.01, 10.0),
    (78.2, 15.6),
    (-77.8, 166.7),
    (10.0, 179.95),
]


def around(lat_deg: float, lon_deg: float, count: int, within_m: float) -> list[tuple[float, float]]:
    rng = random.Random(4)
    geod = Geod(ellps="WGS84")
    points = []
    for _ in range(count):
        lon, lat, _ = geod.fwd(lon_deg, lat_deg, rng.uniform(0, 360), within_m * rng.random())
        points.append((lat, lon))
    return points


@pytest.mark.parametrize(("lat_deg", "lon_deg"), ORIGINS)
def test_east_and_north_agree_with_pyproj_to_a_micrometre_within_20_km(lat_deg: float, lon_deg: float) -> None:
    topocentric = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat_deg} +lon_0={lon_deg} +h_0=0"
    )
    plane = LocalPlane(lat_deg, lon_deg)
    for lat, lon in around(lat_deg, lon_deg, 100, 20_000.0):
        east, north, _ = topocentric.transform(lon, lat, 0.0)
        assert plane.to_east_north_m(lat, lon) == pytest.approx((east, north), abs=1e-6)


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [*ORIGINS, (90.0, 0.0), (-90.0, 30.0)])
def test_there_and_back_is_exact_to_1e_12_degrees_within_3000_km(lat_deg: float, lon_deg: float) -> None:
    plane = LocalPlane(lat_deg, lon_deg)
    for within_m in (100.0, 20_000.0, 3e6):
        for lat, lon in around(lat_deg, lon_deg, 100, within_m):
            back_lat, back_lon = plane.to_lat_lon_deg(*plane.to_east_north_m(lat, lon))
            assert back_lat == pytest.approx(lat, abs=1e-12)
            turn = math.remainder(back_lon - lon, 360.0) * math.cos(math.radians(lat))
            assert turn == pytest.approx(0.0, abs=1e-12)


def test_beyond_the_rim_of_the_earth_there_is_no_place() -> None:
    plane = LocalPlane(50.3, -4.1)
    assert plane.to_lat_lon_deg(6.3e6, 0.0) == pytest.approx((5.6, 76.8), abs=10)
    for far in ((6.5e6, 0.0), (0.0, -1e9), (1e300, 1e300), (math.inf, 0.0), (math.nan, 0.0)):
        assert all(map(math.isnan, plane.to_lat_lon_deg(*far)))


def test_the_plane_measures_like_the_geodesic_and_points_the_right_way() -> None:
    plane = LocalPlane(50.3, -4.1)
    geod = Geod(ellps="WGS84")
    for azimuth, sign in ((45.0, (1, 1)), (135.0, (1, -1)), (225.0, (-1, -1)), (315.0, (-1, 1))):
        lon, lat, _ = geod.fwd(-4.1, 50.3, azimuth, 2_000.0)
        east, north = plane.to_east_north_m(lat, lon)
        assert east * sign[0] > 1_300
        assert north * sign[1] > 1_300
        assert (east**2 + north**2) ** 0.5 == pytest.approx(2_000.0, abs=1e-3)


def test_the_origin_is_zero() -> None:
    assert LocalPlane(50.3, -4.1).to_east_north_m(50.3, -4.1) == (0.0, 0.0)
