"""Each notebook of the documentation runs from an empty folder, and is stored without output."""

import shutil

import pytest
from pages import ROOT

nbformat = pytest.importorskip("nbformat", reason="needs the group test")
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def notebook(path):
    return nbformat.read(path, as_version=4)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_begins_with_a_title_and_has_no_output(path):
    cells = notebook(path).cells
    assert cells[0].cell_type == "markdown"
    assert cells[0].source.startswith("# ")
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs_and_draws(path, tmp_path):
    from nbclient import NotebookClient

    folder = tmp_path / "examples" / "notebooks"
    folder.mkdir(parents=True)
    shutil.copy2(ROOT / "examples" / "locate_survey.py", folder.parent)
    ran = notebook(path)
    NotebookClient(ran, resources={"metadata": {"path": str(folder)}}, timeout=600).execute()
    outputs = [output for cell in ran.cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", ()) for output in outputs)
    assert not [output["text"] for output in outputs if output.get("name") == "stderr"]
