"""Configurations of the paper's authors' program as studies, and studies as its configurations."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.authors.export import export_authors as export_authors
    from pymantaray.apps.authors.simulation import import_authors as import_authors

__getattr__, __dir__, __all__ = lazy_exports(__name__)
