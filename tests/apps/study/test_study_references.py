"""What a study relies on is cited: each part of it by its own references, and nothing else."""

import re
import tomllib
from importlib.resources import files

import pytest
import xarray as xr

from pymantaray import load_study
from pymantaray.apps.study import citation, run_study
from pymantaray.apps.study.references import Citations
from pymantaray.config import list_presets
from pymantaray.errors import OceanError
from pymantaray.ocean.equations import EQUATIONS

CAST = "depth,sound_speed\n0,1440\n500,1450\n1000,1460\n"
SONAR = {"source_level_db": 185.0, "frequency_hz": 12e3, "bandwidth_hz": 4e3}
NOISE = {**SONAR, "absorption": "none", "noise_spectral_level_db": 50.0}


def up(**losses):
    return {"acoustics": {"max_surface_bounces": 1, **losses}, "detection": NOISE}


def estimator(**keys):
    return {"conditions": ["straight", {"name": "one", **keys}]}


def eigenray(belief, **options):
    return {"kind": "eigenray", "belief": belief, **options}


PARTS = [
    ({"acoustics": {"currents": True}}, "munk1995"),
    (
        {"ocean": {"source": "synthetic:fram", "centre_lat": 78.0, "centre_lon": 0.0}},
        "rudels2005 rudels2000 beszczynska2012 richter2018 hofmann2021 wekerle2020",
    ),
    (
        {"ocean": {"source": "synthetic:beaufort", "equation": "del-grosso"}},
        "delgrosso1974 wong1995",
    ),
    ({"ocean": {"source": "synthetic:beaufort", "equation": "unesco"}}, "chen1977 wong1995"),
    ({"detection": NOISE}, ""),
    ({"detection": SONAR}, "francois1982a francois1982b wenz1962"),
    ({"detection": {**SONAR, "absorption": "ainslie-mccolm"}}, "ainslie1998 wenz1962"),
    ({"detection": {**NOISE, "absorption": "thorp"}}, "thorp1967 jensen"),
    (up(surface_loss="bubbles"), "apl-uw1994"),
    (up(surface_loss="coherent"), "pierson1964"),
    ({"acoustics": {"max_bottom_bounces": 1, "sediment": "silt"}, "detection": NOISE}, "jensen"),
    (
        {"acoustics": {"max_bottom_bounces": 1, "sediment": "fine-silt"}, "detection": NOISE},
        "apl-uw1994",
    ),
    ({"detection": {**NOISE, "leakage": True}}, "itu-p526"),
    (estimator(loss="huber"), ""),
    (estimator(loss="gnc"), "yang2020"),
    (estimator(solver="incremental"), "dellaert2012 kaess2012"),
    (estimator(solver={"kind": "fixed-lag", "lag_h": 8.0}), "dellaert2012"),
    (estimator(solver="kalman-filter"), "sola2017"),
    (estimator(range_model=eigenray("mean", modes={"count": 2})), "munk1995"),
    (
        estimator(range_model=eigenray({"kind": "numerics", "equation": "unesco"})),
        "chen1977 wong1995",
    ),
]


def keys_of(references: Citations) -> set[str]:
    return {reference.key for reference in references}


def data_file(path, **attrs):
    xr.Dataset(attrs=attrs).to_netcdf(path)
    return str(path)


@pytest.mark.parametrize(("sections", "keys"), PARTS)
def test_each_part_brings_its_own_references(tiny, sections, keys):
    assert keys_of(citation(tiny(**sections))) - keys_of(citation(tiny())) == set(keys.split())


def test_every_reference_is_that_of_some_study(tiny, tmp_path):
    names = [
        data_file(tmp_path / f"{word}.nc", source=f"{word} v1")
        for word in ("HYCOM", "GLORYS12", "GEBCO", "ETOPO1")
    ]
    cited = keys_of(citation(tiny(ocean={"source": names}))) | keys_of(citation(tiny()))
    for sections, _ in PARTS:
        cited |= keys_of(citation(tiny(**sections)))
    for name in EQUATIONS:
        cited |= keys_of(citation(tiny(ocean={"source": "synthetic:beaufort", "equation": name})))
    text = (files("pymantaray") / "references.toml").read_text(encoding="utf-8")
    assert cited == {*tomllib.loads(text), "mantaray"}


def test_a_study_of_ranges_alone_has_no_trajectory_error(tiny):
    sections = {"study": {"name": "ranges"}, "conditions": []}
    assert keys_of(citation(tiny())) - keys_of(citation(tiny(**sections))) == {"sturm2012"}


def test_data_are_cited_by_what_they_say_of_themselves(tiny, tmp_path):
    hycom = data_file(tmp_path / "ts3z.nc", source="HYCOM archive file")
    mine = data_file(tmp_path / "mine_2.nc", title="my model")
    bed = data_file(tmp_path / "bed.nc", title="The GEBCO_2024 Grid")
    (tmp_path / "cast.csv").write_text(CAST, encoding="utf-8")
    belief = {"kind": "file", "source": [str(tmp_path / "cast.csv")]}
    references = citation(
        tiny(
            ocean={"source": [hycom, mine], "bathymetry": bed},
            **estimator(range_model=eigenray(belief)),
        )
    )
    by = {reference.key: reference for reference in references}
    assert by["chassignet2008"].used_for == "ocean"
    assert by["weatherall2015"].used_for == "sea floor"
    assert str(by["mine_2"]) == f"{mine}, data; cite as their provider asks"
    assert by["cast"].used_for == "ocean that an estimator assumes"
    assert not {"steele2004", "zhao2015"} & by.keys()


def test_a_synthetic_ocean_there_is_not_is_refused_by_those_there_are(tiny, tmp_path):
    unknown = tiny(ocean={"source": "synthetic:beaufot"})
    with pytest.raises(OceanError, match="'beaufot' is unknown; available: beaufort, fram"):
        run_study(unknown, tmp_path / "run")


def test_files_of_one_name_have_keys_of_their_own(tiny, tmp_path):
    (tmp_path / "other").mkdir()
    names = ("ocean.nc", "other/ocean.nc", "my ocean, 2.nc", "jensen.nc")
    references = citation(
        tiny(ocean={"source": [data_file(tmp_path / n, title="mine") for n in names]})
    )
    keys = {
        r.fields["title"].removeprefix(f"{tmp_path}/"): r.key
        for r in references
        if "provider" in r.fields.get("note", "")
    }
    assert keys == dict(zip(names, ("ocean", "ocean-2", "my-ocean-2", "jensen-2"), strict=True))
    assert re.findall(r"^@\w+\{([\w-]+),$", references.bibtex, re.MULTILINE) == [
        r.key for r in references
    ]


@pytest.mark.parametrize("preset", list_presets())
def test_text_and_bibtex_hold_every_reference_once(preset, as_stored):
    references = citation(load_study(preset))
    entries = re.findall(r"^@\w+\{([\w-]+),$", references.bibtex, re.MULTILINE)
    assert entries == [reference.key for reference in references]
    as_stored([str(reference) for reference in references if reference.key != "mantaray"])
    assert len(set(entries)) == len(entries)
    assert references.bibtex.count("{") == references.bibtex.count("}")
    assert not re.search(r"(?<!\\)[&%#_]", references.bibtex)
    assert all(f"  {reference}\n" in f"{references}\n" for reference in references)
