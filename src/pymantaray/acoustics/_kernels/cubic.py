"""The cubic Hermite polynomial that stands for a step of a ray and for the miss between two rays."""

from pymantaray.compile import inlined, kernel


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


@kernel
def cubic_root(h, f0, d0, f1, d1):
    """Fraction of an interval h at which the cubic is zero; the values at the ends differ in sign."""
    lo, hi = 0.0, 1.0
    for _ in range(40):
        t = 0.5 * (lo + hi)
        if (cubic(t, h, f0, d0, f1, d1) > 0.0) == (f0 > 0.0):
            lo = t
        else:
            hi = t
    return 0.5 * (lo + hi)
