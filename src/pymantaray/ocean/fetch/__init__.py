"""Oceans fetched by place and time: HYCOM over OPeNDAP, GLORYS12 from Copernicus Marine."""

from pymantaray.ocean.fetch.copernicus import fetch_copernicus
from pymantaray.ocean.fetch.hycom import Fetched, fetch_hycom
from pymantaray.ocean.fetch.limits import Limits

__all__ = ["Fetched", "Limits", "fetch_copernicus", "fetch_hycom"]
