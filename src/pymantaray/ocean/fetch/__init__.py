"""Download of oceans by place and time: HYCOM over OPeNDAP, GLORYS12 from Copernicus Marine."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.ocean.fetch.copernicus import fetch_copernicus as fetch_copernicus
    from pymantaray.ocean.fetch.hycom import FetchResult as FetchResult, fetch_hycom as fetch_hycom
    from pymantaray.ocean.fetch.limits import FetchLimits as FetchLimits

__getattr__, __dir__, __all__ = lazy_exports(__name__)
