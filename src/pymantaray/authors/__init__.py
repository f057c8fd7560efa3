"""Files for the paper's authors' program from a study or its run; `load_study` and `open_water` read such files."""

from pymantaray.apps.export.authors_program import export_authors

__all__ = ["export_authors"]
