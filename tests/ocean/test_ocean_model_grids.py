"""
Oceans on the grids of ROMS, CROCO, NEMO, MOM6, polar stereographic models and rotated poles give
the water that they were made of: temperatures and currents linear in latitude, longitude and depth.

The grids are regular in a conformal projection of pyproj, so rows and columns cross at right
angles, and geodesics of pyproj give the directions of the velocities.
"""

import gsw
import numpy as np
import pyproj
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import ocean_times, open_ocean, sea_floor_depth, to_local
from pymantaray.ocean.curvilinear import CurvilinearGrid, Regridding
from pymantaray.ocean.model_levels import cell_depth, s_level_depth

EAST, NORTH = 0.3, -0.1  # m/s
TIMES = [0.0, 3.0]
SINCE = {"units": "hours since 2020-01-01", "standard_name": "time"}
LAT, LON = {"units": "degrees_north"}, {"units": "degrees_east"}
LEVELS = np.array([2.0, 6.0, 15.0, 40.0, 100.0, 220.0, 400.0, 700.0, 1100.0])
POLAR = pyproj.CRS("+proj=stere +lat_0=90 +lon_0=-45 +ellps=WGS84")
GEOD = pyproj.Geod(ellps="WGS84")


def warmth(lat, lon, depth):
    """Potential temperature [degC], linear in latitude, longitude and depth."""
    return 12.0 + 0.8 * (lat - 36.0) - 0.5 * np.asarray(lon + 75.0) - 0.004 * depth


def current(lat, lon):
    """Current to east and north [m/s], linear in latitude and longitude."""
    return EAST + 0.4 * (lat - 36.0) + 0.3 * (lon + 75.0), NORTH - 0.2 * (lat - 36.0)


class Grid:
    """Conformal grid of rows and columns about a place, turned; coordinates at any indices."""

    def __init__(self, shape=(44, 40), centre=(36.0, -75.0), turn=0.5, step=3000.0):
        self.shape, self.turn, self.step = shape, turn, step
        text = f"+proj=stere +lat_0={centre[0]} +lon_0={centre[1]} +ellps=WGS84"
        self.crs = pyproj.CRS(text)
        self._to_degrees = pyproj.Transformer.from_crs(
            self.crs, self.crs.geodetic_crs, always_xy=True
        ).transform

    def indices(self, row=0.0, column=0.0, less=(0, 0)):
        shape = self.shape[0] - less[0], self.shape[1] - less[1]
        return np.meshgrid(np.arange(shape[0]) + row, np.arange(shape[1]) + column, indexing="ij")

    def place(self, rows, columns):
        """Latitude and longitude of indices. [degrees]"""
        x = self.step * (columns - 0.5 * self.shape[1])
        y = self.step * (rows - 0.5 * self.shape[0])
        c, s = np.cos(self.turn), np.sin(self.turn)
        lon, lat = self._to_degrees(c * x - s * y, s * x + c * y)
        return np.asarray(lat), np.asarray(lon)

    def along(self, rows, columns, step):
        """Velocity [m/s] along a step (rows, columns) at indices."""
        (lat0, lon0), (lat1, lon1) = (
            self.place(rows + k * step[0], columns + k * step[1]) for k in (-0.01, 0.01)
        )
        azimuth = np.radians(GEOD.inv(lon0, lat0, lon1, lat1)[0])
        east, north = current(*self.place(rows, columns))
        return east * np.sin(azimuth) + north * np.cos(azimuth)

    def angle(self):
        """Angle of the columns' axis from east at the points. [rad]"""
        rows, columns = self.indices()
        (lat0, lon0), (lat1, lon1) = (self.place(rows, columns + k) for k in (-0.01, 0.01))
        return 0.5 * np.pi - np.radians(GEOD.inv(lon0, lat0, lon1, lat1)[0])

    def bed(self):
        rows, _ = self.indices()
        return 400.0 + 500.0 * (1.0 + np.tanh((rows - 22.0) / 9.0))

    def mask(self):
        """1 in water, 0 in a corner that is land."""
        rows, columns = self.indices()
        return np.where((rows < 8) & (columns < 9), 0.0, 1.0)


def dated(values):
    """The same values at two times."""
    return np.stack([values, values])


def roms(transform=2, *, croco=False, levels=24):
    """File of ROMS or CROCO, with sea level; its velocities are on the sides of the cells."""
    grid = Grid()
    rows, columns = grid.indices()
    lat, lon = grid.place(rows, columns)
    bed, zeta, critical = grid.bed(), 0.4 * np.sin(columns / 9.0), 60.0
    s = (np.arange(levels) + 0.5) / levels - 1.0
    stretching = np.sinh(4.0 * s) / np.sinh(4.0)
    if transform == 2:  # the equations of the ROMS manual, for heights
        share = (critical * s[:, None, None] + bed * stretching[:, None, None]) / (critical + bed)
        z = zeta + (zeta + bed) * share
    else:
        still = critical * s[:, None, None] + (bed - critical) * stretching[:, None, None]
        z = still + zeta * (1.0 + still / bed)
    gone = 0.0 if croco else np.nan
    water = np.where(grid.mask() > 0, warmth(lat, lon, -z), gone)
    salt = np.where(grid.mask() > 0, 35.0 + 0.0 * z, gone)
    on_u, on_v = grid.indices(column=0.5, less=(0, 1)), grid.indices(row=0.5, less=(1, 0))
    u, v = grid.along(*on_u, (0, 1)), grid.along(*on_v, (1, 0))
    dims = ("time", "s_rho", "eta_rho", "xi_rho")
    data = xr.Dataset(
        {
            "temp": (dims, dated(water), {"units": "Celsius"}),
            "salt": (dims, dated(salt)),
            "u": (
                ("time", "s_rho", "eta_u", "xi_u"),
                dated(np.broadcast_to(u, (levels, *u.shape))),
                {"units": "meter second-1"},
            ),
            "v": (
                ("time", "s_rho", "eta_v", "xi_v"),
                dated(np.broadcast_to(v, (levels, *v.shape))),
                {"units": "meter second-1"},
            ),
            "zeta": (("time", "eta_rho", "xi_rho"), dated(zeta)),
            "h": (("eta_rho", "xi_rho"), bed),
            "angle": (("eta_rho", "xi_rho"), grid.angle(), {"units": "radians"}),
            "mask_rho": (("eta_rho", "xi_rho"), grid.mask()),
        },
        coords={
            "time": ("time", TIMES, SINCE),
            "lat_rho": (("eta_rho", "xi_rho"), lat, {"units": "degree_north"}),
            "lon_rho": (("eta_rho", "xi_rho"), lon, {"units": "degree_east"}),
        },
        attrs={"title": "ROMS"},
    )
    if croco:
        attrs = {"VertCoordType": "NEW", "hc": critical}
        return [data.assign(sc_r=("s_rho", s), Cs_r=("s_rho", stretching)).assign_attrs(attrs)]
    own = {"s_rho": ("s_rho", s), "Cs_r": ("s_rho", stretching)}
    return [data.assign(own | {"hc": critical, "Vtransform": transform})]


def nemo(*, partial=True):
    """Files of NEMO by kind of point, with zeros on land; cells are cut by the sea bed."""
    grid = Grid()
    rows, columns = grid.indices()
    lat, lon = grid.place(rows, columns)
    edges = np.concatenate([[0.0], 0.5 * (LEVELS[1:] + LEVELS[:-1]), [1300.0]])
    bed = np.where(grid.mask() > 0, np.minimum(grid.bed(), 1290.0), 0.0)
    top, low = edges[:-1, None, None], edges[1:, None, None]
    wet = top < bed
    thickness = np.where(wet, np.minimum(low, bed) - top if partial else low - top, low - top)
    cut = wet & (low > bed) & partial
    depth = np.where(cut, top + 0.5 * thickness, LEVELS[:, None, None])
    water = np.where(wet, warmth(lat, lon, depth), 0.0)
    sides = {
        "U": (grid.indices(column=0.5), (0, 1), "vozocrtx"),
        "V": (grid.indices(row=0.5), (1, 0), "vomecrty"),
    }

    def file(kind, points, fields):
        where = grid.place(*points)
        dims = ("time_counter", f"depth{kind.lower()}", "y", "x")
        return xr.Dataset(
            {
                name: (dims, dated(values).astype("f8"), {"units": unit})
                for name, values, unit in fields
            },
            coords={
                dims[1]: (dims[1], LEVELS, {"units": "m", "positive": "down"}),
                "nav_lat": (("y", "x"), where[0], LAT),
                "nav_lon": (("y", "x"), where[1], LON),
                "time_counter": ("time_counter", TIMES, SINCE),
            },
        )

    tracers = [("votemper", water, "degC"), ("vosaline", np.where(wet, 35.0, 0.0), "1e-3")]
    files = [file("T", (rows, columns), tracers)]
    for kind, (points, step, name) in sides.items():
        speed = np.broadcast_to(grid.along(*points, step), water.shape)
        files.append(file(kind, points, [(name, speed, "m/s")]))
    mesh = xr.Dataset({"e3t_0": (("t", "z", "y", "x"), thickness[None])})
    return [*files, mesh] if partial else files


def mom6(*, symmetric=True):
    """File of MOM6 and its static file; symmetric velocities have one more point."""
    grid = Grid()
    rows, columns = grid.indices()
    lat, lon = grid.place(rows, columns)
    wet = np.broadcast_to(grid.mask() > 0, (LEVELS.size, *grid.shape))
    water = np.where(wet, warmth(lat, lon, LEVELS[:, None, None]), np.nan)
    half, more = (-0.5, -1) if symmetric else (0.5, 0)
    u = grid.along(*grid.indices(column=half, less=(0, more)), (0, 1))
    v = grid.along(*grid.indices(row=half, less=(more, 0)), (1, 0))
    fields = {
        "thetao": (("yh", "xh"), water, "sea_water_potential_temperature", "degC"),
        "so": (("yh", "xh"), np.where(wet, 35.0, np.nan), "sea_water_salinity", "psu"),
        "uo": (("yh", "xq"), np.broadcast_to(u, (9, *u.shape)), "sea_water_x_velocity", "m s-1"),
        "vo": (("yq", "xh"), np.broadcast_to(v, (9, *v.shape)), "sea_water_y_velocity", "m s-1"),
    }
    data = xr.Dataset(
        {
            name: (
                ("time", "z_l", *dims),
                dated(values),
                {"standard_name": standard_name, "units": units},
            )
            for name, (dims, values, standard_name, units) in fields.items()
        },
        coords={
            "time": ("time", TIMES, SINCE),
            "z_l": ("z_l", LEVELS, {"units": "meters", "positive": "down"}),
            "xh": ("xh", np.arange(40.0), {"units": "degrees"}),
            "yh": ("yh", np.arange(44.0), {"units": "degrees"}),
        },
    )
    static = xr.Dataset(
        {
            "geolat": (("yh", "xh"), lat, {"units": "degrees_north"}),
            "geolon": (("yh", "xh"), lon, {"units": "degrees_east"}),
            "deptho": (("yh", "xh"), np.where(grid.mask() > 0, 1250.0, 0.0), {"units": "m"}),
        }
    )
    return [data, static]


def polar():
    """File on a polar stereographic grid across 89 degrees north, with descending y in 100 km."""
    x, y = np.arange(-8, 9) * 0.125, np.arange(6, -7, -1) * 0.125 - 1.6
    transform = pyproj.Transformer.from_crs(POLAR, POLAR.geodetic_crs, always_xy=True).transform
    x2, y2 = np.meshgrid(1e5 * x, 1e5 * y)
    lon, lat = transform(x2, y2)
    speed = []
    for dx, dy in ((1.0, 0.0), (0.0, 1.0)):
        lon1, lat1 = transform(x2 + dx, y2 + dy)
        lon0, lat0 = transform(x2 - dx, y2 - dy)
        azimuth = np.radians(GEOD.inv(lon0, lat0, lon1, lat1)[0])
        speed.append(EAST * np.sin(azimuth) + NORTH * np.cos(azimuth))
    shape = (LEVELS.size, *lat.shape)
    water = np.broadcast_to(1.0 + 2e-6 * (x2 - y2) - 0.001 * LEVELS[:, None, None], shape)
    fields = {
        "thetao": (water, "sea_water_potential_temperature", "degC"),
        "so": (np.full(shape, 35.0), "sea_water_salinity", "1e-3"),
        "vxo": (np.broadcast_to(speed[0], shape), "sea_water_x_velocity", "m s-1"),
        "vyo": (np.broadcast_to(speed[1], shape), "sea_water_y_velocity", "m s-1"),
    }
    return xr.Dataset(
        {
            name: (
                ("time", "depth", "y", "x"),
                dated(values),
                {"standard_name": standard_name, "units": units, "grid_mapping": "stereographic"},
            )
            for name, (values, standard_name, units) in fields.items()
        },
        coords={
            "x": ("x", x, {"standard_name": "projection_x_coordinate", "units": "100 km"}),
            "y": ("y", y, {"standard_name": "projection_y_coordinate", "units": "100 km"}),
            "depth": ("depth", LEVELS, {"units": "m", "positive": "down"}),
            "latitude": (("y", "x"), lat, LAT),
            "longitude": (("y", "x"), lon, LON),
            "time": ("time", TIMES, SINCE),
            "stereographic": (
                (),
                0,
                {
                    "grid_mapping_name": "polar_stereographic",
                    "straight_vertical_longitude_from_pole": -45.0,
                    "latitude_of_projection_origin": 90.0,
                    "scale_factor_at_projection_origin": 1.0,
                    "semi_major_axis": 6378273.0,
                    "semi_minor_axis": 6378273.0,
                },
            ),
        },
    )


def rotated_pole():
    """File on a rotated pole without latitudes and longitudes, with currents to east and north."""
    rlat, rlon = np.linspace(-1.0, 1.0, 21), np.linspace(-1.2, 1.2, 25)
    attrs = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 30.0,
        "grid_north_pole_longitude": -160.0,
    }
    # colatitude and azimuth about the rotated pole, by the sphere's cosine rules
    pole, turn = np.radians(30.0), np.radians(-160.0)
    y, x = np.meshgrid(np.radians(rlat), np.radians(rlon), indexing="ij")
    sine = np.sin(y) * np.sin(pole) + np.cos(y) * np.cos(x) * np.cos(pole)
    lat = np.degrees(np.arcsin(sine))
    lon = np.degrees(
        turn
        + np.pi
        + np.arctan2(
            np.cos(y) * np.sin(x), np.cos(y) * np.cos(x) * np.sin(pole) - np.sin(y) * np.cos(pole)
        )
    )
    water = warmth(lat, lon - 95.0, LEVELS[:, None, None]) - 12.0
    fields = {
        "thetao": (water, "sea_water_potential_temperature", "degC"),
        "so": (np.full_like(water, 35.0), "sea_water_salinity", "1e-3"),
        "uo": (np.full_like(water, EAST), "eastward_sea_water_velocity", "m s-1"),
        "vo": (np.full_like(water, NORTH), "northward_sea_water_velocity", "m s-1"),
    }
    data = xr.Dataset(
        {
            name: (
                ("time", "depth", "rlat", "rlon"),
                dated(values),
                {"standard_name": standard_name, "units": units, "grid_mapping": "pole"},
            )
            for name, (values, standard_name, units) in fields.items()
        },
        coords={
            "rlat": ("rlat", rlat, {"standard_name": "grid_latitude", "units": "degrees"}),
            "rlon": ("rlon", rlon, {"standard_name": "grid_longitude", "units": "degrees"}),
            "depth": ("depth", LEVELS, {"units": "m", "positive": "down"}),
            "time": ("time", TIMES, SINCE),
            "pole": ((), 0, attrs),
        },
    )
    return data, (lat, lon)


def potential(ocean):
    """Potential temperature of an ocean, by gsw. [degC]"""
    lat, lon, depth = (ocean[name].values for name in ("lat", "lon", "depth"))
    pressure = gsw.p_from_z(-depth[:, None, None], lat[:, None])
    salinity = gsw.SA_from_SP(ocean["salinity"].values, pressure, lon, lat[:, None])
    return gsw.pt0_from_t(salinity, ocean["water_temp"].values, pressure)


def inside(ocean, margin, reach):
    """Wet points whose columns within a margin of points are wet at all levels to a depth [m]."""
    upper = ocean["depth"].values <= reach
    wet = np.isfinite(ocean["water_temp"].values[upper]).all(axis=0)
    whole = wet.copy()
    for axis in (0, 1):
        for shift in range(-margin, margin + 1):
            whole &= np.roll(wet, shift, axis=axis)
    whole[:margin] = whole[-margin:] = whole[:, :margin] = whole[:, -margin:] = False
    return whole


def check_water(ocean, first, last, *, shift=0.0, lon=None, uniform=False):
    """Compare temperatures between two depths [m], and all currents, with those of the model."""
    depth = ocean["depth"].values
    levels = (depth >= first) & (depth <= last)
    columns = inside(ocean, 3, last)  # at the edge of a grid, a velocity has one neighbour
    assert columns.sum() > 80
    lon = ocean["lon"].values if lon is None else lon
    expected = warmth(ocean["lat"].values[:, None], lon, depth[:, None, None]) + shift
    error = np.abs(potential(ocean) - expected)[levels][:, columns]
    assert error.max() < 1e-4
    speeds = (EAST, NORTH) if uniform else current(ocean["lat"].values[:, None], lon)
    for name, value in zip(("water_u", "water_v"), speeds, strict=True):
        assert np.abs(ocean[name].values - value)[levels][:, columns].max() < 2e-4


@pytest.mark.parametrize(
    ("files", "first", "last"),
    [
        (roms(2), 8.0, 380.0),
        (roms(1), 8.0, 380.0),
        (roms(croco=True), 8.0, 380.0),
        (nemo(), 2.0, 380.0),
        (mom6(), 2.0, 1100.0),
        (mom6(symmetric=False), 2.0, 1100.0),
    ],
    ids=["roms 2", "roms 1", "croco", "nemo", "mom6", "mom6 not symmetric"],
)
def test_water_of_a_model_is_that_of_its_grid(files, first, last):
    ocean = open_ocean(files, time="2020-01-01T03:00")
    check_water(ocean, first, last)
    assert "interpolated from a curvilinear grid" in ocean.attrs["history"]
    assert ocean["time"].values == np.datetime64("2020-01-01T03:00")


def test_projected_water_near_the_pole_keeps_its_currents():
    ocean = open_ocean(polar(), time="2020-01-01", window=(88.0, 89.2, -70.0, -20.0))
    assert ocean["lat"].values[-1] > 89.0
    transform = pyproj.Transformer.from_crs(POLAR.geodetic_crs, POLAR, always_xy=True).transform
    x, y = transform(*np.meshgrid(ocean["lon"], ocean["lat"]))
    depth = ocean["depth"].values[1:, None, None]
    expected = 1.0 + 2e-6 * (x - y) - 0.001 * depth
    np.testing.assert_allclose(potential(ocean)[1:], expected, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(ocean["water_u"], EAST, atol=2e-4)
    np.testing.assert_allclose(ocean["water_v"], NORTH, atol=2e-4)


def test_a_rotated_pole_needs_no_latitudes_in_two_dimensions():
    data, (lat, lon) = rotated_pole()
    ocean = open_ocean(data, time="2020-01-01")
    assert lat.min() < ocean["lat"].values[0]
    assert lon.max() > ocean["lon"].values[-1]
    check_water(ocean, 2.0, 1100.0, shift=-12.0, lon=ocean["lon"].values - 95.0, uniform=True)


def layers():
    """MOM6 on layers of density, with their thickness, which varies in time."""
    data, static = mom6()
    thickness = np.diff(np.concatenate([[0.0], 0.5 * (LEVELS[1:] + LEVELS[:-1]), [1250.0]]))
    squeezed = thickness[:, None, None] * (1.0 + 0.1 * np.sin(Grid().indices()[1] / 9.0))
    lat, lon = (static[name].values for name in ("geolat", "geolon"))
    middle = np.cumsum(squeezed, axis=0) - 0.5 * squeezed
    water = np.where(np.isfinite(data["thetao"]), warmth(lat, lon, middle), np.nan)
    data = data.rename(z_l="zl").assign_coords(zl=np.linspace(1020.0, 1028.0, LEVELS.size))
    data["zl"].attrs = {"units": "kg m-3"}
    dims = ("time", "zl", "yh", "xh")
    return [
        data.assign(thetao=(dims, water, data["thetao"].attrs), h=(dims, dated(squeezed))),
        static,
    ]


def nominal(long_name="h point nominal latitude"):
    """MOM6 with nominal latitudes and longitudes on its axes, as it writes them."""
    data, static = mom6(symmetric=False)
    axes = {}
    for dim, place, attrs in (
        ("yh", static["geolat"][:, 20], LAT),
        ("xh", static["geolon"][22], LON),
        ("yq", static["geolat"][:, 20] + 0.013, LAT),
        ("xq", static["geolon"][22] + 0.017, LON),
    ):
        axes[dim] = (dim, place.values, attrs | {"long_name": long_name})
    return [data.assign_coords(axes), static]


@pytest.mark.parametrize("long_name", ["h point nominal latitude", ""])
def test_nominal_axes_of_a_model_are_not_its_grid(long_name):
    check_water(open_ocean(nominal(long_name), time="2020-01-01"), 2.0, 1100.0)


def test_nominal_axes_without_the_grid_are_refused():
    with pytest.raises(OceanError, match="yh is a nominal latitude, not that of the grid"):
        open_ocean(nominal()[:1], time="2020-01-01", currents="rest")


def test_coordinates_of_corners_are_not_those_of_the_water():
    """In one file, coordinates of the corners are before those of temperature and velocity."""
    grid = Grid()
    data, static = mom6(symmetric=False)
    corners = {}
    for letter, dims, shift in (
        ("c", ("yq", "xq"), (0.5, 0.5)),
        ("u", ("yh", "xq"), (0.0, 0.5)),
        ("v", ("yq", "xh"), (0.5, 0.0)),
    ):
        lat, lon = grid.place(*grid.indices(*shift))
        corners |= {f"geolat_{letter}": (dims, lat, LAT), f"geolon_{letter}": (dims, lon, LON)}
    check_water(
        open_ocean(xr.merge([xr.Dataset(corners), data, static]), time="2020-01-01"), 2, 1100
    )
    alone = xr.merge([static, data])
    check_water(open_ocean(alone, time="2020-01-01"), 2.0, 1100.0)
    water, *velocities = nemo()
    lat, lon = grid.place(*grid.indices(0.5, 0.5))
    first = xr.Dataset({"gphif": (("y", "x"), lat, LAT), "glamf": (("y", "x"), lon, LON)})
    check_water(open_ocean([xr.merge([first, water]), *velocities], time="2020-01-01"), 2.0, 380.0)


def test_thicknesses_of_full_cells_are_no_depths():
    water, *velocities, mesh = nemo()
    thickness = xr.Dataset({"e3t_1d": ("deptht", np.gradient(LEVELS), {"units": "m"})})
    depth = ("deptht", LEVELS, {"units": "m", "positive": "down"})
    water = xr.merge([thickness, water]).drop_vars("deptht").assign_coords(gdept_1d=depth)
    files = [water, *velocities, mesh]
    check_water(open_ocean(files, time="2020-01-01"), 2.0, 380.0)


def test_the_bed_and_cells_of_a_model_have_units():
    (data,) = roms()
    bed = data.assign(h=(data["h"].dims, 1e-3 * data["h"].values, {"units": "km"}))
    check_water(open_ocean([bed], time="2020-01-01"), 8.0, 380.0)
    layered, static = layers()
    cells = layered.assign(h=(layered["h"].dims, 100.0 * layered["h"].values, {"units": "cm"}))
    check_water(open_ocean([cells, static], time="2020-01-01"), 10.0, 900.0)
    upward = data.assign(h=-data["h"])
    with pytest.raises(
        OceanError, match=r"h is -.* it must be the depth of the bed, positive down"
    ):
        open_ocean([upward], time="2020-01-01")


def test_angles_of_a_grid_may_be_in_degrees():
    (data,) = roms()
    turn = np.degrees(data["angle"].values)
    stated = data.assign(angle=(data["angle"].dims, turn, {"units": "degrees"}))
    check_water(open_ocean([stated], time="2020-01-01"), 8.0, 380.0)
    unstated = data.assign(angle=(data["angle"].dims, turn))
    with pytest.raises(OceanError, match=r"angle is up to 2.*, which is no angle in radians"):
        open_ocean([unstated], time="2020-01-01")


def test_layers_are_where_their_thickness_puts_them():
    check_water(open_ocean(layers(), time="2020-01-01"), 10.0, 900.0)


def test_thicknesses_are_those_of_the_file_and_the_instant():
    """The second of two files has thicker layers, with the water at their middles."""
    data, static = layers()
    thick = 1.3 * data["h"]
    lat, lon = (static[name].values for name in ("geolat", "geolon"))
    middle = np.cumsum(thick.values[0], axis=0) - 0.5 * thick.values[0]
    water = np.where(np.isfinite(data["thetao"]), warmth(lat, lon, middle), np.nan)
    times = xr.Variable("time", [6.0, 9.0], SINCE)
    later = data.assign(h=thick, thetao=(data["thetao"].dims, water, data["thetao"].attrs))
    files = [data, later.assign_coords(time=times), static]
    check_water(open_ocean(files, time="2020-01-01T09:00"), 10.0, 900.0)
    check_water(open_ocean(files, time="2020-01-01T03:00"), 10.0, 900.0)


@pytest.mark.parametrize("transform", [1, 2])
def test_s_levels_reach_from_the_bed_to_the_sea_level(transform):
    bed, zeta = np.array([40.0, 900.0]), np.array([0.5, -0.3])
    s = np.linspace(-1.0, 0.0, 9)
    depth = s_level_depth(s, np.sinh(4.0 * s) / np.sinh(4.0), 60.0, bed, zeta, transform)
    np.testing.assert_allclose(depth[0], bed, atol=1e-9)
    np.testing.assert_allclose(depth[-1], -zeta, atol=1e-9)
    assert np.all(np.diff(depth[:, 1]) < 0.0)


@pytest.mark.parametrize("files", [roms(), nemo()], ids=["roms", "nemo"])
def test_the_sea_floor_is_that_of_the_model(files):
    ocean = open_ocean(files, time="2020-01-01")
    floor = sea_floor_depth(ocean).values
    water = np.isfinite(ocean["water_temp"].values)
    levels = np.append(ocean["depth"].values, np.inf)
    count = water.sum(axis=0)
    assert np.all(floor[count == 0] == 0.0)
    deep = count > 0
    assert np.all(floor[deep] >= levels[count[deep] - 1])
    assert np.all(floor[deep] <= levels[count[deep]])
    bed = np.minimum(Grid().bed(), 1290.0 if len(files) > 1 else np.inf)
    assert floor.max() == pytest.approx(bed.max(), rel=0.02)
    assert floor[deep].min() == pytest.approx(bed.min(), rel=0.05)


def test_land_of_a_model_stays_dry():
    grid = Grid()
    lat, lon = grid.place(*grid.indices())
    for files in (roms(), roms(croco=True), nemo(), mom6()):
        ocean = open_ocean(files, time="2020-01-01", window=(35.4, 35.8, -75.9, -75.0))
        wet = np.isfinite(ocean["water_temp"].values[0])
        apart = (lat[..., None, None] - ocean["lat"].values[:, None]) ** 2 + (
            0.8 * (lon[..., None, None] - ocean["lon"].values)
        ) ** 2
        nearest = apart.reshape(-1, *wet.shape).argmin(axis=0)
        same = wet == (grid.mask().ravel()[nearest] > 0)
        assert 0.02 < 1.0 - wet.mean() < 0.9
        assert same.mean() > 0.95


def test_only_the_window_is_read(tmp_path):
    data = roms()[0]
    data.to_netcdf(tmp_path / "roms.nc", engine="scipy", format="NETCDF3_64BIT")
    whole = open_ocean(tmp_path / "roms.nc", time="2020-01-01")
    part = open_ocean(tmp_path / "roms.nc", time="2020-01-01", window=(35.9, 36.1, -75.1, -74.9))
    assert "(44 by 40 points" in whole.attrs["history"]
    assert part.sizes["lat"] < 10
    rows = int(part.attrs["history"].split("(")[1].split(" by ")[0])
    assert rows < 25
    same = whole["lat"].values[np.isin(whole["lat"].values.round(9), part["lat"].values.round(9))]
    assert same.size > 3
    a, b = (
        o["water_temp"].sel(lat=same, method="nearest").interp(depth=50.0, lon=-75.0)
        for o in (whole, part)
    )
    np.testing.assert_allclose(a, b, atol=1e-3)


def test_a_box_ends_beside_its_window_on_all_sides():
    """It has two more rows and columns, also across the antimeridian."""
    lat, lon = np.meshgrid(np.arange(60.0, 70.0), np.arange(170.0, 200.0), indexing="ij")
    grid = CurvilinearGrid(lat, np.where(lon > 180.0, lon - 360.0, lon))
    box = grid.box((63.0, 65.0, 179.0, -175.0), "grid")
    assert (box.rows, box.columns) == (slice(1, 8), slice(7, 18))


def test_a_model_has_its_times_and_becomes_a_file(tmp_path):
    for files in (roms(), nemo()):
        np.testing.assert_array_equal(
            ocean_times(files), np.array(["2020-01-01T00", "2020-01-01T03"], "datetime64[ns]")
        )
    ocean = open_ocean(nemo(), time="2020-01-01")
    ocean.to_netcdf(tmp_path / "ocean.nc")
    again = open_ocean(tmp_path / "ocean.nc")
    xr.testing.assert_identical(again, ocean)


def test_rays_pass_through_the_water_of_roms(tmp_path):
    """A domain over ROMS has the sound speed of the model's linear temperature."""
    roms()[0].to_netcdf(tmp_path / "roms.nc", engine="scipy", format="NETCDF3_64BIT")
    ocean = open_ocean(tmp_path / "roms.nc", time="2020-01-01T03:00")
    local = to_local(ocean, centre=(36.0, -75.0), half_extent=(15e3, 15e3))
    depth = local["depth"].values
    level = int(np.argmin(np.abs(depth - 200.0)))
    pressure = gsw.p_from_z(-depth[level], 36.0)
    salinity = gsw.SA_from_SP(35.0, pressure, -75.0, 36.0)
    potential_temperature = warmth(36.0, -75.0, depth[level])
    expected = gsw.sound_speed(salinity, gsw.CT_from_pt(salinity, potential_temperature), pressure)
    found = float(local["sound_speed"].interp(north=0.0, east=0.0).isel(depth=level))
    assert found == pytest.approx(expected, abs=2e-3)


REFUSED = {
    "no grid file": (mom6()[:1], "name the file with the model's grid too"),
    "no bed": ([roms()[0].drop_vars("h")], "no file has the depth of the bed (h)"),
    "no critical depth": ([roms()[0].drop_vars("hc")], "no critical depth hc"),
    "no equation": ([roms()[0].drop_vars("Vtransform")], "set Vtransform to 1 or 2"),
    "no levels": ([roms()[0].drop_vars("Cs_r")], "no s-coordinate (s_rho, Cs_r, hc)"),
    "no salinity": ([roms()[0].drop_vars("salt")], "no file has its salinity"),
    "no unit of time": ([roms()[0].assign_coords(time=("time", TIMES))], "no coordinate of time"),
    "velocity of another grid": (
        [nemo()[0], nemo()[1].isel(x=slice(20)), nemo()[2].isel(x=slice(20))],
        "belong to different grids",
    ),
    "files of two grids": (
        [roms()[0], roms()[0].isel(eta_rho=slice(30))],
        "all files must have one grid",
    ),
    "members": ([d.expand_dims(member=2) for d in mom6()[:1]] + mom6()[1:], "'member'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_incomplete_model_is_refused_in_one_line(case):
    files, cause = REFUSED[case]
    with pytest.raises(OceanError) as error:
        open_ocean(files, time="2020-01-01")
    assert cause in str(error.value)
    assert "\n" not in str(error.value)


def test_a_window_outside_a_model_is_refused():
    with pytest.raises(OceanError, match="no grid point in the window"):
        open_ocean(roms(), time="2020-01-01", window=(10.0, 11.0, 5.0, 6.0))


def test_a_cut_cell_is_in_the_middle_of_the_rest():
    """The last of three cells is 12 m of 20 m thick; full cells keep their own depths."""
    thickness = np.array([[10.0, 10.0], [20.0, 20.0], [20.0, 12.0]])
    full = np.array([5.2, 20.5, 41.0])
    np.testing.assert_allclose(
        cell_depth(thickness, full), [[5.2, 5.2], [20.5, 20.5], [41.0, 36.0]]
    )
    np.testing.assert_allclose(
        cell_depth(thickness, None), [[5.0, 5.0], [20.0, 20.0], [40.0, 36.0]]
    )


@pytest.mark.parametrize("place", [(0.3, 0.2), (0.6, 0.7), (0.8, 0.7)])
def test_wet_corners_share_the_weights_of_dry_ones(place):
    """Three corners of a cell are wet; a place in the water has half of the weights there."""
    grid = CurvilinearGrid(*np.meshgrid([10.0, 11.0], [20.0, 21.0], indexing="ij"))
    lat, lon = (np.array([first + share]) for first, share in zip((10.0, 20.0), place, strict=True))
    u, v = place[1], place[0]
    weights = np.array([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v])
    found = Regridding.to(grid, lat, lon)(np.array([[0.0, 1.0], [2.0, np.nan]]))
    if weights.sum() < 0.5:
        assert np.isnan(found).all()
        return
    assert found[0, 0] == pytest.approx(weights @ [0.0, 1.0, 2.0] / weights.sum(), abs=5e-3)


def test_the_axes_of_a_window_reach_its_sides():
    """Points at half degrees, axes at whole ones: those at the sides need points outside."""
    half = np.arange(12) + 0.5
    whole = CurvilinearGrid(*np.meshgrid(half, half, indexing="ij"))
    window = (2.0, 7.0, 3.0, 8.0)
    lat, lon = whole.part(whole.box(window, "grid")).axes(window, "grid")
    np.testing.assert_allclose(lat[[0, -1]], window[:2])
    np.testing.assert_allclose(lon[[0, -1]], window[2:])
