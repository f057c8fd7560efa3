"""
TEOS-10 as we call it; Del Grosso and UNESCO against published values, Wong and Zhu's forms against
the originals.
"""

from typing import get_args

import gsw
import numpy as np
import pandas as pd
import pytest
from numpy.polynomial.polynomial import polyval2d

from pymantaray.errors import OceanError
from pymantaray.ocean.equations import EQUATIONS, Equation, del_grosso, unesco
from pymantaray.ocean.seawater import absolute_and_conservative, in_situ_temperature, sound_speed

T68 = 1.00024  # IPTS-68 over ITS-90 temperature

# Fofonoff and Millard (1983), UNESCO 44, section 9: S = 25, 30, 35; rows 0 to 10,000 dbar, columns
# 0 to 40 degC; second-hand from two public test suites that reprint the table
TABLE = {
    25.0: """
        1435.8 1477.7 1510.3 1535.2 1553.4   1452.0 1494.1 1527.0 1552.1 1570.6
        1468.6 1510.7 1543.6 1569.0 1587.6   1485.6 1527.5 1560.3 1585.7 1604.5
        1502.8 1544.3 1576.9 1602.4 1621.3   1520.4 1561.3 1593.6 1619.0 1638.0
        1538.1 1578.4 1610.3 1635.5 1654.6   1556.0 1595.6 1626.9 1651.9 1671.0
        1574.1 1612.8 1643.5 1668.2 1687.2   1592.2 1630.1 1660.2 1684.5 1703.3
        1610.4 1647.4 1676.8 1700.6 1719.2
    """,
    30.0: """
        1442.5 1483.7 1515.9 1540.4 1558.3   1458.8 1500.2 1532.5 1557.3 1575.4
        1475.4 1516.8 1549.2 1574.1 1592.3   1492.4 1533.6 1565.8 1590.8 1609.2
        1509.7 1550.4 1582.4 1607.4 1626.0   1527.2 1567.4 1599.1 1624.0 1642.7
        1544.9 1584.4 1615.7 1640.4 1659.2   1562.7 1601.5 1632.3 1656.8 1675.6
        1580.7 1618.7 1648.9 1673.1 1691.8   1598.8 1636.0 1665.5 1689.3 1707.8
        1616.8 1653.3 1682.1 1705.4 1723.5
    """,
    35.0: """
        1449.1 1489.8 1521.5 1545.6 1563.2   1465.5 1506.3 1538.1 1562.4 1580.2
        1482.3 1523.0 1554.7 1579.2 1597.1   1499.3 1539.7 1571.3 1595.9 1613.9
        1516.5 1556.5 1587.9 1612.5 1630.7   1534.0 1573.4 1604.5 1629.0 1647.3
        1551.6 1590.4 1621.0 1645.4 1663.8   1569.4 1607.5 1637.6 1661.7 1680.1
        1587.2 1624.6 1654.1 1677.9 1696.2   1605.2 1641.8 1670.6 1694.0 1712.2
        1623.2 1659.0 1687.2 1710.1 1727.8
    """,
}


def chen_millero_1977(t68, s, bar):
    """The original, for IPTS-68 temperatures: an oracle written apart from the package's tables."""
    pure = [
        [1402.388, 5.03711, -5.80852e-2, 3.3420e-4, -1.47800e-6, 3.1464e-9],
        [0.153563, 6.8982e-4, -8.1788e-6, 1.3621e-7, -6.1185e-10, 0.0],
        [3.1260e-5, -1.7107e-6, 2.5974e-8, -2.5335e-10, 1.0405e-12, 0.0],
        [-9.7729e-9, 3.8504e-10, -2.3643e-12, 0.0, 0.0, 0.0],
    ]
    a = [
        [1.389, -1.262e-2, 7.164e-5, 2.006e-6, -3.21e-8],
        [9.4742e-5, -1.2580e-5, -6.4885e-8, 1.0507e-8, -2.0122e-10],
        [-3.9064e-7, 9.1041e-9, -1.6002e-10, 7.988e-12, 0.0],
        [1.100e-10, 6.649e-12, -3.389e-13, 0.0, 0.0],
    ]
    b = [[-1.922e-2, -4.42e-5], [7.3637e-5, 1.7945e-7]]
    t68, s, bar = np.broadcast_arrays(t68, s, bar)
    first = polyval2d(bar, t68, np.array(pure)) + polyval2d(bar, t68, np.array(a)) * s
    return first + polyval2d(bar, t68, np.array(b)) * s**1.5 + (1.727e-3 - 7.9836e-6 * bar) * s**2


def del_grosso_1974(t, s, p):
    """The original, for IPTS-68 temperatures and kgf/cm2."""
    return (
        1402.392
        + (0.501109398873e1 + (-0.550946843172e-1 + 0.221535969240e-3 * t) * t) * t
        + (0.132952290781e1 + 0.128955756844e-3 * s) * s
        + (0.156059257041e0 + (0.244998688441e-4 - 0.883392332513e-8 * p) * p) * p
        + (-0.127562783426e-1 * s + 0.635191613389e-2 * p + 0.265484716608e-7 * t * p**2) * t
        + (-0.159349479045e-5 * p**2 + 0.522116437235e-9 * p**3 - 0.438031096213e-6 * t**2 * p) * t
        + (-0.161674495909e-8 * s * p**2 + 0.968403156410e-4 * t**2) * s
        + (0.485639620015e-5 * s - 0.340597039004e-3) * t * s * p
    )


def test_unesco_gives_the_published_table_within_rounding():
    p, t = np.arange(0.0, 10_001.0, 1_000.0)[:, None], np.arange(0.0, 41.0, 10.0)
    for s, text in TABLE.items():
        published = np.array(text.split(), dtype=float).reshape(11, 5)
        np.testing.assert_allclose(
            chen_millero_1977(t, s, p / 10.0), published, rtol=0, atol=0.0501
        )
        # Wong and Zhu's revision is within 0.024 m/s of the original
        np.testing.assert_allclose(unesco(t / T68, s, p), published, rtol=0, atol=0.05 + 0.024)


# S 40, 40 degC (IPTS-68), 10,000 dbar of UNESCO 44, within Wong and Zhu's revision; the National
# Physical Laboratory's calculator at 100 kPa as a public test suite reprints it, whose conversion
# of pressure for Del Grosso has seven digits
@pytest.mark.parametrize(("equation", "water", "published", "within"), [
    (lambda t, s, p: chen_millero_1977(t * T68, s, p / 10.0), (40.0 / T68, 40.0, 10_000.0),
     1731.995, 5e-4),
    (unesco, (40.0 / T68, 40.0, 10_000.0), 1731.995, 0.024),
    (unesco, (5.0, 35.0, 10.0), 1470.898591964845, 1e-9),
    (del_grosso, (5.0, 35.0, 10.0), 1470.8074947307055, 1e-6),
])  # fmt: skip
def test_check_values(equation, water, published, within):
    assert equation(*water) == pytest.approx(published, abs=within)


@pytest.mark.parametrize(("new", "old", "warmest", "freshest", "deepest", "within"), [
    (del_grosso, lambda t, s, p: del_grosso_1974(t, s, p / 9.80665), 30.0, 30.0, 9_806.0, 0.017),
    (unesco, lambda t, s, p: chen_millero_1977(t, s, p / 10.0), 40.0, 0.0, 10_000.0, 0.024),
])  # fmt: skip
def test_forms_for_its_90_equal_the_originals_within_their_bounds(
    new, old, warmest, freshest, deepest, within
):
    t, s, p = (
        np.random.default_rng(3)
        .uniform([0.0, freshest, 0.0], [warmest, 40.0, deepest], (2_000, 3))
        .T
    )
    assert np.abs(new(t, s, p) - old(T68 * t, s, p)).max() < within


def test_the_equations_agree_in_the_open_ocean_as_they_are_known_to(as_stored):
    """
    Del Grosso is within 0.1 m/s of TEOS-10; UNESCO is 0.5 to 0.7 m/s faster in deep cold water.
    """
    water = np.array([[15.0, 6.0, 3.0, 1.5], [35.5, 35.0, 34.9, 34.9], [0.0, 1e3, 2e3, 4e3]])
    teos, grosso, millero = (
        sound_speed(*water, 30.0, -40.0, equation=e) for e in ("teos-10", "del-grosso", "unesco")
    )
    np.testing.assert_allclose(grosso, teos, rtol=0, atol=0.15)
    assert 0.3 < (millero - grosso)[-1] < 1.0
    np.testing.assert_allclose(millero[:1], teos[:1], rtol=0, atol=0.15)
    as_stored(water)


def test_the_instruments_own_sound_speed_is_one_of_the_equations(shared_data, as_stored):
    """Of the XCTD, which computes it itself: to the noise of 1 m means of its three columns."""
    table = pd.read_csv(shared_data / "casts" / "beaufort_xctd_icex20_1.csv", comment="#").iloc[
        100:
    ]
    water = (table[name] for name in ("temperature_degC", "practical_salinity", "depth_m"))
    found = sound_speed(*water, 71.2, -142.4, equation="unesco")
    np.testing.assert_allclose(found, table["sound_speed_m_s"], rtol=0, atol=0.25)
    as_stored(table)


@pytest.mark.parametrize("equation", ["teos-10", "del-grosso", "unesco"])
def test_arguments_broadcast_gaps_stay_and_speed_rises_with_each(equation):
    t = np.array([[1.0, np.nan], [2.0, 3.0]])
    found = sound_speed(
        t, 35.0, np.array([[0.0], [100.0]]), 10.0, np.array([20.0, 21.0]), equation=equation
    )
    assert found.shape == (2, 2)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(t))
    base = sound_speed(0.0, 34.0, 100.0, 78.0, 0.0, equation=equation)
    for other in ((1.0, 34.0, 100.0), (0.0, 35.0, 100.0), (0.0, 34.0, 200.0)):
        assert sound_speed(*other, 78.0, 0.0, equation=equation) > base


def test_an_unknown_equation_is_refused():
    allowed = ", ".join(EQUATIONS)
    with pytest.raises(OceanError, match=f"'nonsense' is unknown; allowed: {allowed}$"):
        sound_speed(0.0, 35.0, 0.0, 0.0, 0.0, equation="nonsense")


def test_potential_temperature_of_in_situ_temperature_is_the_start():
    depth = np.array([0.0, 500.0, 2_500.0, 4_000.0])
    theta = np.array([-1.5, 0.7, -0.5, -0.5])
    t = in_situ_temperature(theta, 34.9, depth, 75.0, -140.0)
    SA, CT, _ = absolute_and_conservative(t, 34.9, depth, 75.0, -140.0)
    np.testing.assert_allclose(gsw.pt_from_CT(SA, CT), theta, rtol=0, atol=1e-9)
    assert np.all(t[1:] > theta[1:])  # compression warms
    assert t[0] == theta[0]


def test_every_name_of_an_equation_has_its_entry():
    assert get_args(Equation) == tuple(EQUATIONS)


@pytest.mark.parametrize("equation", EQUATIONS)
def test_equations_agree_in_the_open_ocean(equation):
    """Equations differ by less than 0.8 m/s where all are valid."""
    temperature, pressure = np.meshgrid([2.0, 10.0, 20.0], [0.0, 1000.0, 4000.0])
    speed, reference = (
        EQUATIONS[name].sound_speed(temperature, 35.0, pressure, 45.0, -30.0)
        for name in (equation, "teos-10")
    )
    np.testing.assert_allclose(speed, reference, rtol=0.0, atol=0.8)
