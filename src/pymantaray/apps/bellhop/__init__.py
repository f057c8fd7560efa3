"""
BELLHOP3D: writer of its input files, reader of its output files, and comparison of its travel times
with those of this package.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.bellhop.options import (
        BellhopOptions as BellhopOptions,
        HalfSpace as HalfSpace,
    )
    from pymantaray.apps.bellhop.output import (
        read_bellhop_arrivals as read_bellhop_arrivals,
        read_bellhop_rays as read_bellhop_rays,
    )
    from pymantaray.apps.bellhop.run import compare_with_bellhop as compare_with_bellhop
    from pymantaray.apps.bellhop.write import (
        linear_medium as linear_medium,
        write_bellhop as write_bellhop,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
