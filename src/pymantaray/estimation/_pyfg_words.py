"""Words and orders of the PyFactorGraph text format that writer and reader share."""

POSE, LANDMARK = "VERTEX_SE3:QUAT", "VERTEX_XYZ"
POSE_PRIOR, LANDMARK_PRIOR = "VERTEX_SE3:QUAT:PRIOR", "VERTEX_XYZ:PRIOR"
EDGE, RANGE = "EDGE_SE3:QUAT", "EDGE_RANGE"
SIGHTING = "EDGE_SE3_XYZ"  # a landmark's place in the body frame of a pose
FLAT = ("VERTEX_SE2", "VERTEX_XY", "VERTEX_SE2:PRIOR", "VERTEX_XY:PRIOR", "EDGE_SE2", "EDGE_SE2_XY")

AGENT_LETTERS = "ABCDEFGHIJKMNOPQRSTUVWXYZ"
LANDMARK_LETTER = "L"  # not a vehicle's
FREE_VARIANCE = 1e12  # an axis with this variance or more is not constrained
TO_FILE = [3, 4, 5, 0, 1, 2]  # rotation before translation, and back: the exchange is its own inverse
