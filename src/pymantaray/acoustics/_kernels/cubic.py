"""The cubic Hermite polynomial that stands for a step of a ray and for the miss between two rays."""

from pymantaray.acoustics._kernels.compile import inlined


@inlined
def cubic(t, h, f0, d0, f1, d1):
    """Value at the fraction t of an interval h, from values and slopes at its ends."""
    t2 = t * t
    t3 = t2 * t
    return (
        (1.0 - 3.0 * t2 + 2.0 * t3) * f0
        + (t - 2.0 * t2 + t3) * h * d0
        + (3.0 * t2 - 2.0 * t3) * f1
        + (t3 - t2) * h * d1
    )
