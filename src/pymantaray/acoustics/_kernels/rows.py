"""What is kept of an eigenray: one row of numbers."""

import math

from pymantaray.compile import kernel

# travel time [s], launch and arrival angle [rad], spreading [dB], turning points, slowness vectors at both
# ends [s/m] (3 + 3), reflections at the surface and at the sea bed
N_COLUMNS = 13


@kernel
def finish(row, y, angle, q, target, turns, c0, c1, length, un, ue, cb, sb0, sb1, det):
    """Fill a result row with the ray that ended in state y, moved by its small miss onto the receiver.

    The travel time changes by the slowness at the receiver times the miss (Fermat) and half its rate of
    change; the slownesses by their derivatives along the variation. sb0 and sb1 are the axis' tilt at both ends, det the
    determinant of the end offsets by the launch angle and the slowness out of the plane.
    """
    miss = y[0] - target
    rate = y[3] / y[2] if y[2] != 0.0 else 0.0
    p1, q1 = y[1], y[6]
    row[0] = (y[4] - p1 * miss - q1 * y[5] + 0.5 * rate * miss * miss) / c0
    shift = miss / y[2] if y[2] != 0.0 else 0.0
    if abs(shift) < 1e-4:
        angle -= shift
        p1 -= rate * miss
    if y[7] > 0.0:
        q -= y[5] / y[7]
        q1 -= y[5] / y[7]
    n1 = c0 / c1
    h1 = math.sqrt(max(n1 * n1 - p1 * p1 - q1 * q1, 0.0))
    p0 = math.sin(angle)
    h0 = math.sqrt(max(1.0 - p0 * p0 - q * q, 0.0))
    tube = abs(det / math.cos(angle) * (h1 / n1) * h0)
    row[3] = 10.0 * math.log10(max(tube, 1e-300) * n1 / (length * length))
    row[4] = turns
    for end in range(2):
        p, side, h, sb = (p0, q, h0, sb0) if end == 0 else (p1, q1, h1, sb1)
        along = h * cb - p * sb
        down = h * sb + p * cb
        row[1 + end] = math.atan2(down, math.hypot(along, side))
        row[5 + 3 * end] = (along * un - side * ue) / c0
        row[6 + 3 * end] = (along * ue + side * un) / c0
        row[7 + 3 * end] = down / c0


@kernel
def sort_rows(rows, count):
    """Sort the first count rows by travel time."""
    for i in range(1, count):
        j = i
        while j > 0 and rows[j - 1, 0] > rows[j, 0]:
            for k in range(N_COLUMNS):
                rows[j - 1, k], rows[j, k] = rows[j, k], rows[j - 1, k]
            j -= 1
