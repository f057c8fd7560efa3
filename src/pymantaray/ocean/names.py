"""Names of oceans without a file, of equations of the sound speed, and of rules for currents."""

from typing import Literal

SYNTHETIC = "synthetic:"
"""Prefix of the name of a synthetic ocean, as in ``synthetic:fram``."""
Equation = Literal["teos-10", "del-grosso", "unesco"]
"""Names of the equations of the sound speed of sea water."""
CurrentsPolicy = Literal["required", "rest"]
"""Oceans without currents: refused, or at rest."""
