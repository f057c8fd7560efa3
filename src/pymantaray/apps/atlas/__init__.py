"""
Atlas of range errors with straight rays in every column of an ocean, by convention, and of links
without a direct path.

Examples
--------
>>> from pymantaray.apps.atlas import Atlas, AtlasLinks, open_atlas, run_atlas
>>> links = AtlasLinks(pairs=((100.0, 300.0),), distances=(1_000.0, 3_000.0), bearings=2)
>>> definition = Atlas("synthetic:fram", links, every=30)
>>> with open_atlas(run_atlas(definition, "atlas.nc", workers=1)) as file:
...     atlas = file.load()
>>> dict(atlas["range_error"].sizes)
{'time': 1, 'lat': 2, 'lon': 8, 'convention': 5, 'pair': 1, 'distance': 2, 'bearing': 2}
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.atlas.dataset import open_atlas as open_atlas, safety_table as safety_table
    from pymantaray.apps.atlas.figures import write_atlas_plots as write_atlas_plots
    from pymantaray.apps.atlas.links import AtlasLinks as AtlasLinks
    from pymantaray.apps.atlas.page import write_atlas_page as write_atlas_page
    from pymantaray.apps.atlas.plan import Atlas as Atlas
    from pymantaray.apps.atlas.runner import run_atlas as run_atlas

__getattr__, __dir__, __all__ = lazy_exports(__name__)
