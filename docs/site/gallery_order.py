"""Order of the scripts in the gallery."""

SUBJECTS = (
    "bent_ray",
    "duct",
    "eddy",
    "under_ice",
    "flown_table",
    "atlas",
    "locate",
    "replay",
    "sweep",
    "plan",
    "foreign_graph",
)
"""From a single ray to whole studies; scripts that are not listed come last."""


class BySubject:
    """
    Sort key of sphinx-gallery, which creates it with the folder of the scripts and calls it with
    the name of a file.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def __call__(self, filename: str) -> tuple[int, str]:
        """Place of a script."""
        subject = filename.removeprefix("plot_").removesuffix(".py")
        return (SUBJECTS.index(subject) if subject in SUBJECTS else len(SUBJECTS), filename)
