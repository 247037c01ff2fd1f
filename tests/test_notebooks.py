"""The notebooks run from top to bottom, at tiny size, and are committed without outputs."""

import ast
import importlib
import os
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from tests.shared_data import shared_file

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@pytest.fixture
def environment(monkeypatch):
    """The kernel inherits this process's environment."""
    monkeypatch.setenv("BASENET_JAX_NOTEBOOK", "tiny")
    monkeypatch.delenv("BASENET_JAX_DATA", raising=False)


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def pictures(notebook):
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    return sum("image/png" in output.get("data", {}) for output in outputs)


def test_all_notebooks_are_there():
    names = ["01_quickstart", "02_train", "03_results", "04_your_robot", "05_your_room"]
    assert [path.stem for path in NOTEBOOKS] == names


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_valid_begin_with_an_installation_and_hold_no_output(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert "%pip install" in cells[0].source
    assert not any(cell.outputs or cell.execution_count for cell in cells)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_notebooks_import_is_there(path):
    """Also of those that run slow."""
    for cell in code_cells(nbformat.read(path, as_version=4)):
        code = re.sub(r"^( *)[%!].*", r"\1pass", cell.source, flags=re.MULTILINE)  # IPython's own lines
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.Import):
                assert all(importlib.import_module(each.name) for each in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                module = importlib.import_module(node.module)
                for each in node.names:
                    assert hasattr(module, each.name) or importlib.import_module(f"{node.module}.{each.name}")


@pytest.mark.parametrize(
    ("name", "drawn"),
    [
        ("01_quickstart", 3),
        pytest.param("02_train", 2, marks=pytest.mark.slow),
        pytest.param("03_results", 2, marks=pytest.mark.slow),
        pytest.param("04_your_robot", 3, marks=pytest.mark.slow),
        pytest.param("05_your_room", 1, marks=pytest.mark.slow),
    ],
)
def test_a_notebook_runs(name, drawn, tmp_path, environment):
    assert pictures(run(name, tmp_path)) == drawn


@pytest.mark.slow
def test_the_notebook_of_rooms_plans_on_the_maps_that_are_there(tmp_path, environment, monkeypatch):
    for name in ("depot.yaml", "hangar_map.yaml"):
        folder = shared_file(f"maps/{name}").parents[1]
    monkeypatch.setenv("BASENET_JAX_DATA", str(folder))
    assert pictures(run("05_your_room", tmp_path)) == 2


def run(name, tmp_path):
    notebook = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    client = NotebookClient(
        notebook,
        timeout=None,
        startup_timeout=3600,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    )
    client.execute()
    assert os.listdir(tmp_path)
    return notebook
