"""The tutorial runs from its first cell to its last, in its own kernel."""

from pathlib import Path

import pytest

TUTORIAL = Path(__file__).resolve().parents[3] / "docs" / "tutorial.ipynb"


@pytest.mark.filterwarnings("ignore")  # warnings of the kernel's own libraries
def test_the_tutorial_runs_and_compensation_helps(tmp_path: Path) -> None:
    import nbformat  # every worker imports this file, only one runs it
    from nbclient import NotebookClient

    notebook = nbformat.read(TUTORIAL, 4)
    client = NotebookClient(notebook, timeout=200, resources={"metadata": {"path": tmp_path}})
    client.execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    shown = [out["data"]["text/html"] for out in outputs if "text/html" in out.get("data", {})]
    assert len(shown) == 4  # model, validation, diagnosis, drive
    assert all("data:image/png;base64," in html for html in shown)
    (said,) = [out["text"] for out in outputs if out.output_type == "stream"]
    _, _, linear, _, _, straight, _ = said.split()
    assert float(straight) < 0.3 * float(linear)
