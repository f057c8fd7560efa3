"""Words and orders of the PyFactorGraph text format that writer and reader share."""

POSE, LANDMARK = "VERTEX_SE3:QUAT", "VERTEX_XYZ"
POSE_PRIOR, LANDMARK_PRIOR = "VERTEX_SE3:QUAT:PRIOR", "VERTEX_XYZ:PRIOR"
EDGE, RANGE = "EDGE_SE3:QUAT", "EDGE_RANGE"

AGENT_LETTERS = "ABCDEFGHIJKMNOPQRSTUVWXYZ"  # L is for landmarks
FREE_VARIANCE = 1e12  # an axis with this variance or more is not constrained
TO_FILE = [3, 4, 5, 0, 1, 2]  # rotation before translation, and back: the exchange is its own inverse
