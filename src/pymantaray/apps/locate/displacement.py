"""Displacement of an array of nodes between two campaigns, with its covariance."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.special import chdtrc

from pymantaray.apps.locate.fit_tests import LEVEL
from pymantaray.apps.locate.survey import LARGEST_POSITION
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.tangent_plane import TangentPlane
from pymantaray.jobs.keys import CHECKSUM, has_checksum
from pymantaray.messages import one_line
from pymantaray.ocean.convert import parse_instant
from pymantaray.records.position_rows import is_position
from pymantaray.user_files import read_text

if TYPE_CHECKING:
    from pymantaray.apps.locate.location import Location

CAMPAIGN_FILE = "location.json"
_AXES = ("north", "east", "depth")
_ORIGIN_SIZE = 2
_FARTHEST = 1e5  # m; between positions of one node
_MIN_VARIANCE = 1e-9  # of a combination of positions, relative to the largest


@dataclass(frozen=True, eq=False)
class Campaign:
    """
    Positions of the nodes of one campaign.

    Attributes
    ----------
    names : list of str
        Nodes.
    positions : ndarray, shape (n_nodes, 3)
        North, east, depth below the sea surface in the frame. [m]
    covariance : ndarray, shape (3 n_nodes, 3 n_nodes)
        Joint covariance. [m²]
    origin : tuple of float or None
        Latitude and longitude of the frame's origin; None if they are unknown. [degrees]
    epoch : numpy.datetime64
        UTC of the middle of the pings; NaT if it is unknown.
    source : str
        File, for messages.
    """

    names: list[str]
    positions: Array
    covariance: Array
    origin: tuple[float, float] | None
    epoch: np.datetime64
    source: str

    def in_frame(self, origin: tuple[float, float] | None, source: str) -> "Campaign":
        """Campaign in the frame of another one with this origin, from this source."""
        if (self.origin is None) != (origin is None):
            with_frame, without = (self.source, source) if self.origin else (source, self.source)
            raise LocateError(
                f"{without}: positions without latitude and longitude; those of {with_frame} have"
                " them; both campaigns need them, or neither"
            )
        if self.origin is None or origin is None or self.origin == origin:
            return self
        old = LocalFrame(*self.origin)
        new = LocalFrame(*origin)
        lat, lon = old.to_geodetic(self.positions[:, 0], self.positions[:, 1])
        north, east = new.to_local(lat, lon)
        angle = float(new.convergence(*self.origin))
        turn = np.array(
            [
                [np.cos(angle), -np.sin(angle), 0.0],
                [np.sin(angle), np.cos(angle), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        all_turns = np.kron(np.eye(len(self.names)), turn)
        return replace(
            self,
            positions=np.column_stack([north, east, self.positions[:, 2]]),
            covariance=all_turns @ self.covariance @ all_turns.T,
            origin=origin,
        )

    def of_nodes(self, names: list[str]) -> "Campaign":
        """Campaign of some of the nodes, in the order of their names."""
        rows = np.array([self.names.index(name) for name in names])
        columns = (3 * rows[:, None] + np.arange(3)).ravel()
        covariance = self.covariance[np.ix_(columns, columns)]
        return replace(self, names=names, positions=self.positions[rows], covariance=covariance)


@dataclass(frozen=True, eq=False)
class Displacement:
    """
    Displacement of the nodes of two campaigns as one rigid body, without rotation.

    Attributes
    ----------
    value : ndarray, shape (3,)
        North, east, depth: later minus earlier. [m]
    covariance : ndarray, shape (3, 3)
        Covariance of the value. [m²]
    nodes : list of str
        Nodes of both campaigns.
    chi_square, degrees, probability : float
        Test of the same arrangement of the nodes in both campaigns.
    widening : float
        Factor of the standard deviations due to a failed test, at least 1; `covariance` contains
        it.
    years : float
        Time between the campaigns; NaN if it is unknown.
    source : str
        File of the earlier campaign.
    """

    value: Array
    covariance: Array
    nodes: list[str]
    chi_square: float
    degrees: float
    probability: float
    widening: float
    years: float
    source: str

    @property
    def sigma(self) -> Array:
        """Standard deviations of north, east and depth. [m]"""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of north, east and depth."""
        return np.asarray(self.covariance / np.outer(self.sigma, self.sigma))

    @property
    def table(self) -> pd.DataFrame:
        """One row per axis: displacement, standard deviation, interval, correlations, rate."""
        return pd.DataFrame(
            {
                "axis": _AXES,
                "displacement_m": self.value,
                "sigma_m": self.sigma,
                "low_m": self.value - 1.959964 * self.sigma,
                "high_m": self.value + 1.959964 * self.sigma,
                **{f"correlation_{axis}": self.correlation[k] for k, axis in enumerate(_AXES)},
                "rate_m_per_year": self.value / self.years,
                "rate_sigma_m_per_year": self.sigma / self.years,
            }
        )

    @property
    def notes(self) -> list[str]:
        """Lines that a reader must know."""
        if self.widening == 1.0:
            return []
        text = (
            f"The arrangement of the nodes differs from that in {self.source}: chi-square"
            f" {self.chi_square:.1f} of {self.degrees:.0f}; the standard deviations of the"
            f" displacement are multiplied by {self.widening:.2g}."
        )
        return [text]

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "earlier": self.source,
            "nodes": self.nodes,
            "displacement_m": self.value.tolist(),
            "sigma_m": self.sigma.tolist(),
            "covariance_m2": self.covariance.tolist(),
            "correlation": self.correlation.tolist(),
            "arrangement_chi_square": self.chi_square,
            "arrangement_degrees": self.degrees,
            "arrangement_probability": self.probability,
            "widening": self.widening,
            "years": self.years if np.isfinite(self.years) else None,
        }


def campaign_of(location: "Location") -> Campaign:
    """Campaign of a location."""
    survey = location.survey
    frame = survey.frame
    middle = float(np.median(survey.time))
    epoch = survey.epoch
    if not np.isnat(epoch):
        epoch = epoch + np.timedelta64(round(1e9 * middle), "ns")
    positions = location.positions
    if frame is not None and survey.depth_reference == "plane":
        positions = TangentPlane(frame).to_frame(positions)
    return Campaign(
        survey.names,
        positions,
        location.covariance,
        None if frame is None else (frame.latitude_deg, frame.longitude_deg),
        epoch,
        survey.source,
    )


def campaign_values(location: "Location") -> dict[str, Any]:
    """Values of JSON from which `read_campaign` restores a location's campaign."""
    campaign = campaign_of(location)
    return {
        "names": campaign.names,
        "axes": list(_AXES),
        "positions_m": campaign.positions.tolist(),
        "covariance_m2": campaign.covariance.tolist(),
        "origin_deg": None if campaign.origin is None else list(campaign.origin),
        "epoch_utc": None if np.isnat(campaign.epoch) else str(campaign.epoch),
        "source": campaign.source,
    }


def read_campaign(path: str | Path) -> Campaign:
    """
    Read the campaign of a folder of results, of its ``location.json``, or of printed JSON.

    Raises
    ------
    LocateError
        If the file cannot be read or contains no campaign.

    Examples
    --------
    Continues the example of `pymantaray.apps.locate`:

    >>> from pymantaray.apps.locate import read_campaign, write_location_page
    >>> campaign = read_campaign(write_location_page(location, "M1").parent)
    >>> campaign.names, campaign.covariance.shape
    (['M1'], (3, 3))
    """
    file = Path(path)
    file = file / CAMPAIGN_FILE if file.is_dir() else file
    text = read_text(file, LocateError, what="a JSON file")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LocateError(
            f"{file}: not valid JSON: {one_line(error)}; give {CAMPAIGN_FILE} of the earlier"
            " campaign"
        ) from None
    if isinstance(tree, dict) and CHECKSUM in tree and not has_checksum(tree):
        raise LocateError(
            f"{file}: damaged: its content does not have its checksum; restore it from a copy, or"
            " locate the earlier campaign again"
        )
    try:
        return _campaign(tree["campaign"], str(file))
    except (KeyError, TypeError, ValueError):
        raise LocateError(
            f"{file}: no positions with a joint covariance (key campaign); give {CAMPAIGN_FILE} of"
            " the earlier campaign"
        ) from None
    except OceanError as error:
        raise LocateError(f"{file}: epoch_utc: {error}") from None


def _campaign(values: Any, source: str) -> Campaign:
    """Campaign of values of JSON; other types than those of `campaign_values` raise an error."""
    names = values["names"]
    origin = values["origin_deg"]
    arrays = [np.array(values[name]) for name in ("positions_m", "covariance_m2")]
    arrays.append(np.array([0, 0] if origin is None else origin))
    if (
        values["axes"] != list(_AXES)
        or not isinstance(names, list)
        or arrays[2].shape != (_ORIGIN_SIZE,)
        or any(array.dtype.kind not in "if" for array in arrays)
        or not is_position(*arrays[2])
    ):
        raise ValueError(values)
    positions, covariance, centre = (array.astype(float) for array in arrays)
    k = len(names)
    if (
        not k
        or len(set(names)) < k
        or (positions.shape, covariance.shape)
        != (
            (k, 3),
            (3 * k, 3 * k),
        )
    ):
        raise LocateError(
            f"{source}: {k} names, positions {positions.shape}, covariance {covariance.shape};"
            " they must be of the same nodes, each with one name"
        )
    is_finite = (np.abs(positions) <= LARGEST_POSITION).all()
    is_finite &= (np.abs(covariance) <= LARGEST_POSITION**2).all()
    symmetric = covariance + covariance.T if is_finite else -np.eye(3)
    # rounding may leave negative variances
    if np.linalg.eigvalsh(symmetric).min() < -1e-9 * np.trace(symmetric):
        raise LocateError(
            f"{source}: positions must be finite and within {LARGEST_POSITION:g} m, and"
            " the covariance positive semidefinite"
        )
    epoch = values["epoch_utc"]
    return Campaign(
        [str(name) for name in names],
        positions,
        covariance,
        None if origin is None else (float(centre[0]), float(centre[1])),
        np.datetime64("NaT", "ns") if epoch is None else parse_instant(str(epoch)),
        source,
    )


def displacement_between(later: Campaign, earlier: Campaign) -> Displacement:
    r"""
    Displacement of the nodes that two campaigns have in common.

    Parameters
    ----------
    later, earlier : Campaign
        Two campaigns with independent errors.

    Returns
    -------
    Displacement

    Raises
    ------
    LocateError
        If no node is in both campaigns, or only one has latitudes and longitudes.

    Notes
    -----
    The unknown arrangement of the array is shared: with positions :math:`a` and :math:`a + D`, the
    maximum of the joint likelihood over :math:`a` and :math:`D` is the generalized least-squares
    mean of the differences of all nodes, whose covariance is the sum of both.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.apps.locate import Campaign, displacement_between
    >>> place, covariance = np.array([[30.0, -20.0, 1300.0]]), 1e-4 * np.eye(3)
    >>> years = [np.datetime64(year, "ns") for year in ("2024-07-01", "2026-07-01")]
    >>> earlier = Campaign(["M1"], place, covariance, None, years[0], "2024")
    >>> later = Campaign(["M1"], place + [0.12, 0.0, 0.0], covariance, None, years[1], "2026")
    >>> moved = displacement_between(later, earlier)
    >>> print(moved.value.round(3), moved.sigma.round(3))
    [0.12 0.   0.  ] [0.014 0.014 0.014]
    """
    names = [name for name in later.names if name in earlier.names]
    if not names:
        raise LocateError(
            f"{earlier.source}: its nodes are {', '.join(earlier.names)}, those of {later.source}"
            f" are {', '.join(later.names)}; the campaigns need nodes of the same names"
        )
    now = later.of_nodes(names)
    before = earlier.in_frame(later.origin, later.source).of_nodes(names)
    difference = (now.positions - before.positions).ravel()
    if not np.abs(difference).max() <= _FARTHEST:
        raise LocateError(
            f"{earlier.source}: nodes are {np.abs(difference).max():.3g} m from those of"
            f" {later.source}; allowed are {_FARTHEST:g} m: give the campaign of the same nodes"
        )
    values, vectors = np.linalg.eigh(now.covariance + before.covariance)
    # combinations without variance, such as the shape of a rigid array, contain no information
    free = values > _MIN_VARIANCE * values.max()
    root = vectors[:, free].T / np.sqrt(values[free, None])
    design = root @ np.tile(np.eye(3), (len(names), 1))
    if np.linalg.matrix_rank(design) < 3:
        raise LocateError(
            f"{earlier.source}: the positions of both campaigns are known without error along an"
            " axis; the campaigns need estimated positions"
        )
    covariance = np.linalg.inv(design.T @ design)
    value = covariance @ (design.T @ (root @ difference))
    residual = root @ difference - design @ value
    chi_square = float(residual @ residual)
    degrees = float(free.sum() - 3)
    probability = float(chdtrc(degrees, chi_square)) if degrees else 1.0
    widening = 1.0
    if probability < LEVEL:
        widening = float(np.sqrt(chi_square / degrees))
    years = float((now.epoch - before.epoch) / np.timedelta64(1, "D")) / 365.25  # NaN without dates
    if years < 0.0:
        raise LocateError(
            f"{earlier.source}: is of {before.epoch.astype('M8[s]')}, later than"
            f" {later.source}, of {now.epoch.astype('M8[s]')}; exchange the two campaigns"
        )
    return Displacement(
        value,
        widening**2 * covariance,
        names,
        chi_square,
        degrees,
        probability,
        widening,
        years if years != 0.0 else np.nan,
        earlier.source,
    )
