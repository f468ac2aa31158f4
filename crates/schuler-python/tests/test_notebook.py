"""The notebook runs from its first cell to its last, in a kernel of its own; what it asserts holds."""

from pathlib import Path
from typing import Any

import pytest

nbclient: Any = pytest.importorskip("nbclient", reason="NBCLIENT IS NOT INSTALLED: the notebook is not run")
nbformat: Any = pytest.importorskip("nbformat", reason="NBFORMAT IS NOT INSTALLED: the notebook is not run")
pytest.importorskip("ipykernel", reason="IPYKERNEL IS NOT INSTALLED: the notebook is not run")


@pytest.mark.filterwarnings("ignore")
def test_notebook(tmp_path: Path) -> None:
    path = Path(__file__).parent.parent / "examples" / "explain.ipynb"
    notebook = nbformat.read(path, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "expected a notebook without outputs"
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": tmp_path}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pages = [output["data"]["text/html"] for output in shown if "text/html" in output.get("data", {})]
    assert any("The findings explain the mismatch." in page for page in pages)
    assert any("<svg" in page for page in pages)
