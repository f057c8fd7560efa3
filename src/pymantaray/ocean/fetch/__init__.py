"""Download of oceans by place and time: HYCOM over OPeNDAP, GLORYS12 from Copernicus Marine."""

from pymantaray.ocean.fetch.copernicus import fetch_copernicus
from pymantaray.ocean.fetch.hycom import FetchResult, fetch_hycom
from pymantaray.ocean.fetch.limits import Limits

__all__ = ["FetchResult", "Limits", "fetch_copernicus", "fetch_hycom"]
