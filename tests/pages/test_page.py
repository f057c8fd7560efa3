"""What a page shows of its origin: no folders of a machine, and no rounding errors of numbers."""

import re

import pandas as pd
import pytest

from pymantaray.pages.page import Page, origin_table, without_folders
from pymantaray.records.result_table import ResultTable


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/home/me/data/x.nc", "x.nc"),
        ("mantaray study run a.toml --out /tmp/runs/q", "mantaray study run a.toml --out q"),
        ("--out=/tmp/r/q --set x=1", "--out=q --set x=1"),
        ("run '/home/my name/x y.nc'", "run 'x y.nc'"),
        ("~/data/a.nc, /tmp/b/c/", "a.nc, c/"),
        (r"C:\Users\me\x.nc", "x.nc"),
        ("file:///home/me/x.nc", "x.nc"),
        ("https://host.org/home/me/x.nc", "https://host.org/home/me/x.nc"),
        ("s3://bucket/tmp/x", "s3://bucket/tmp/x"),
        ("../data/x.nc and tables/x.csv", "../data/x.nc and tables/x.csv"),
        ("1/2 m/s, km/h; a / b", "1/2 m/s, km/h; a / b"),
        ("synthetic:beaufort", "synthetic:beaufort"),
    ],
)
def test_local_paths_are_names_of_files(text, expected):
    assert without_folders(text) == expected


def test_no_part_of_a_page_has_a_folder_or_a_rounding_error():
    record = {
        "made": {"command": "mantaray study run /home/me/a.toml --out /tmp/b/out"},
        "ocean": {"sha256": {"/home/me/water.nc": "abc"}, "step": 0.1 + 0.2},
        "steps": [0.1 + 0.2, 2000.0, 1e-9 / 3.0],
    }
    words = pd.DataFrame({"file": ["/home/me/one.nc", "/tmp/b/two.nc"]})
    text = Page(
        "Page",
        facts=["from /home/me/one.nc"],
        description="of /tmp/b/two.nc",
        notes=["/home/me/three.nc: odd"],
        made=["Command: mantaray --out /tmp/b/out"],
        tables=[ResultTable("files", words)],
        origin=[origin_table(record, "Manifest", "manifest.json")],
    ).html()
    body = text.partition("<body>")[2].partition("<script")[0]
    assert not re.search(r"/(home|tmp)\b", body)
    assert not re.search(r"\d\.\d{13}", body)
    for shown in ("one.nc", "two.nc", "three.nc", "--out out", ">0.3<", "0.3, 2000.0", "water.nc"):
        assert shown in body
