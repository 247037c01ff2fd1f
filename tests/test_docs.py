"""What the documentation shows is what there is: its example runs, and its figures stand in the recorded results."""

import json
import re
import runpy
from pathlib import Path

import jax
import numpy as np
import pytest

import basenet_jax as bn
from basenet_jax.config import GridConfig, PickConfig, WorldConfig
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.task.picking import Reason
from basenet_jax.world.room_fields import ALLOWED
from tests.room_texts import TEXT

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))


def test_the_example_planner_plans(monkeypatch, capsys):
    from basenet_jax.planners.registry import PLANNERS

    monkeypatch.syspath_prepend(str(DOCS / "examples"))
    monkeypatch.delitem(PLANNERS, "nearest-stop", raising=False)
    try:
        runpy.run_path(str(DOCS / "examples" / "use_nearest_stop.py"), run_name="__main__")
    finally:
        PLANNERS.pop("nearest-stop", None)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["nearest-stop", "greedy-stops", "basenet"]
    times = [float(line.split()[-2]) for line in lines]
    assert all("4 of 4 grasped" in line for line in lines)
    assert times[2] < times[0], "the learned planner is better than the nearest stop"


def test_the_example_planner_ends_where_no_drive_is_possible_and_plans_for_the_world_it_is_given(monkeypatch):
    """Infinite drives once made it go on for ever; objects that no drive leads to are unreachable."""
    monkeypatch.syspath_prepend(str(DOCS / "examples"))
    example = runpy.run_path(str(DOCS / "examples" / "nearest_stop.py"))
    grid = GridConfig(step_m=0.2, turns=4)
    scene = bn.sample_scene(jax.random.key(3), objects=4).arrays
    planner = example["NearestStop"](PlannerSetup(grid=grid))
    monkeypatch.setattr(planner, "drive", lambda robot, start, goal, room, config: np.full(len(goal), np.inf))
    plan = planner(scene, jax.random.key(0))
    assert not np.any(plan.served)
    assert np.asarray(plan.reason).tolist() == [Reason.UNREACHABLE] * 4
    wide = PlannerSetup(grid=grid, world=WorldConfig(pick=PickConfig(base_clearance_m=0.35)))
    assert len(example["NearestStop"](wide).stops) < len(planner.stops)


def test_the_example_is_as_short_as_the_page_says():
    code = (DOCS / "examples" / "nearest_stop.py").read_text().split("class NearestStop")[1]
    assert len([line for line in code.splitlines() if line.strip()]) <= 30


@pytest.mark.parametrize("path", sorted((DOCS / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_the_page_shows_the_examples_that_run(path):
    """Formatters have taken an included file's line for Python, and then it shows nothing and nobody objects."""
    assert f'\n```{{.python}}\n--8<-- "docs/examples/{path.name}"\n```\n' in (DOCS / "extending.md").read_text()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_page_is_in_the_navigation_and_every_picture_is_there(path):
    assert path.name in (ROOT / "mkdocs.yml").read_text()
    text = path.read_text()
    for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text):
        assert (path.parent / picture).is_file(), picture


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_results_file_that_a_page_names_is_there_with_the_command_that_it_names(path):
    text = path.read_text()
    for name in re.findall(r"benchmarks/results/([\w]+)\.json", text):
        command = json.loads((ROOT / "benchmarks" / "results" / f"{name}.json").read_text())["command"]
        assert command in text, f"{name}.json was made by: {command}"


def test_the_reference_has_every_public_name_once():
    names = re.findall(r"^::: basenet_jax\.(\w+)$", (DOCS / "reference.md").read_text(), re.MULTILINE)
    assert sorted(names) == sorted(bn.__all__)


def test_the_page_of_rooms_has_every_field():
    page = (DOCS / "rooms.md").read_text()
    parents = {path.rpartition(".")[0].removesuffix("[]") for path in ALLOWED}
    for path in ALLOWED:
        parent, _, name = path.rpartition(".")
        if not path.endswith("[]") and name != "name" and path not in parents:
            assert f"`{path}`" in page or (f"`{parent}." in page and f"`.{name}`" in page), path


def test_the_page_of_rooms_quotes_what_is_said(tmp_path):
    """Its example with the start where the pillar stands."""
    page, path = (DOCS / "rooms.md").read_text(), tmp_path / "room.yaml"
    path.write_text(TEXT.replace("start: [4.2, 1.0, 0.0]", "start: [4.0, 3.0, 0.0]"))
    with pytest.raises(bn.SceneFileError) as info:
        bn.load_scene(path)
    assert f"basenet_jax.plan: {str(info.value).replace(str(path), path.name)}\n" in page
