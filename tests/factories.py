"""Small oceans, media, fleets and studies that tests of several folders are made of."""

import tomllib

TINY = tomllib.loads("""
[study]
name = "tiny"
realizations = 2
conditions = ["odometry", "no-ranges", "straight", "refracted", "straight-all"]

[ocean]
source = "synthetic:beaufort"
centre_latitude_deg = 74.5
centre_longitude_deg = -140.0
half_extent_north = 15000.0
half_extent_east = 15000.0

[mission]
duration_h = 4.0
physics_step_s = 1.0
ping_interval_h = 1.0

[fleet.floats]
hold_depth_h = 0.5
hold_surface_h = 0.25

[[fleet.vehicles]]
name = "A"
kind = "station"
north = 0.0
east = 0.0

[[fleet.vehicles]]
name = "B"
kind = "float"
north = 2000.0
east = -1000.0
target_depth = 300.0

[[fleet.vehicles]]
name = "C"
kind = "waypoints"
north = -1000.0
east = 500.0
depth = 40.0
speed = 1.0
points = [[1500.0, 500.0, 60.0], [1500.0, 3000.0, 20.0]]

[[fleet.vehicles]]
name = "D"
kind = "twist"
north = 1000.0
east = 3000.0
depth = 80.0
twist = [0.0, 0.0, 0.001, 0.5, 0.0, 0.0]

[[landmarks]]
name = "L0"
north = 4000.0
east = 4000.0
depth = 500.0

[[landmarks]]
name = "L1"
north = -4000.0
east = 3000.0
depth = 900.0
""")
