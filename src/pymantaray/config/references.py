"""Keys of the publications about data, by the names and attributes of their sources."""

from collections.abc import Iterator

References = Iterator[tuple[str, str]]
"""Keys in `references.toml` or names of files, each with the part of a study that relies on it."""
_SYNTHETIC = {
    "synthetic:beaufort": "steele2004 shimada2005 timmermans2014 timmermans2003 timmermans2008"
    " zhao2014 zhao2015",
    "synthetic:fram": "rudels2005 rudels2000 beszczynska2012 richter2018 hofmann2021 wekerle2020",
}
_SAYS = {
    "hycom": "chassignet2008",
    "glorys": "lellouche2021",
    "gebco": "weatherall2015",
    "etopo1": "amante2009",
}
"""Words in a file's attributes that identify the owner of its data."""


def data_references(source: str, used_for: str) -> References:
    """
    Owner of the data of a source: by name for a synthetic ocean, otherwise by the file's
    attributes.
    """
    from pymantaray.ocean import holds_casts
    from pymantaray.ocean.files import open_file

    if source.startswith("synthetic:"):
        # an unknown name raises an error when it is opened
        for key in _SYNTHETIC.get(source, "").split():
            yield key, f"{used_for}, water masses of {source}"
        return
    said = ""
    if not holds_casts(source):
        with open_file(source) as data:
            said = " ".join(map(str, data.attrs.values())).lower()
    keys = [key for word, key in _SAYS.items() if word in said]
    for key in keys or [source]:
        yield key, used_for
