"""
Standard conditions, and names of ranges, links and losses; few imports, because configurations read
them.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

Ranges = Literal["straight", "refracted"]
MeasuredRanges = Ranges | None
LinkChoice = Literal["refracted", "all"]
LossKind = Literal["huber", "cauchy", "geman-mcclure", "tukey", "welsch"]
LossName = Literal[LossKind, "gnc"]


class StandardCondition(NamedTuple):
    """Ranges and links of a condition that its name defines, or dead reckoning alone."""

    ranges: MeasuredRanges = None
    links: LinkChoice = "refracted"
    dead_reckoned: bool = False


STANDARD: Mapping[str, StandardCondition] = MappingProxyType(
    {
        "odometry": StandardCondition(dead_reckoned=True),
        "no-ranges": StandardCondition(),
        "straight": StandardCondition("straight"),
        "refracted": StandardCondition("refracted"),
        "straight-all": StandardCondition("straight", links="all"),
    }
)
"""Standard conditions, by name."""
