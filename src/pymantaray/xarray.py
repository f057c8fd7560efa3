"""Importing this module adds the accessor ``mantaray`` to data sets of xarray."""

import xarray

from pymantaray.config.door.accessor import OceanAccessor

__all__ = ["OceanAccessor"]

xarray.register_dataset_accessor("mantaray")(OceanAccessor)  # type: ignore[no-untyped-call]
