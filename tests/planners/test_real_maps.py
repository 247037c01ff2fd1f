"""Plans in maps that robots made, whose footprints are tested against the maps' own pixels."""

from pathlib import Path

import jax
import nbformat
import numpy as np
import pytest
import yaml
from PIL import Image

import basenet_jax as bn
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.motion import plan_motion
from tests.shared_data import shared_file

NOTEBOOK = Path(__file__).parents[2] / "notebooks/05_your_room.ipynb"
KEPT_M = 0.045  # of the 0.05 that drives keep clear: turning places stand 1 mm nearer, turns go in steps


def from_notebook(names):
    """Functions and data of the notebook, from its cells that define them."""
    found: dict = {"Path": Path, "Image": Image, "np": np, "yaml": yaml, "bn": bn, "MAPS": Path("nowhere")}
    cells = [cell.source for cell in nbformat.read(NOTEBOOK, as_version=4).cells if cell.cell_type == "code"]
    for cell in cells:
        if any(each in cell for each in ("def cut_out", "ROOMS = {")):
            exec(cell.split("if (MAPS")[0].split("scenes = {}")[0], found)
    return [found[name] for name in names]


def closed_points(path):
    """The centres (m) of all cells that aren't white, which is free in these maps."""
    fields = yaml.safe_load(path.read_text())
    rows = np.asarray(Image.open(path.parent / fields["image"]).convert("L"))[::-1]
    row, column = np.nonzero(rows < 254)
    return np.column_stack([column + 0.5, row + 0.5]) * fields["resolution"] + fields["origin"][:2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "name", "low", "high"),
    [("depot", "depot", (5.0, 0.0), (16.0, 9.0)), ("hangar_map", "hangar", (8.0, 6.0), (20.0, 16.0))],
)
def test_the_robot_grasps_everything_and_stays_clear_of_the_maps_cells(source, name, low, high, tmp_path, monkeypatch):
    path = shared_file(f"maps/{source}.yaml")
    cut_out, rooms = from_notebook(["cut_out", "ROOMS"])
    monkeypatch.chdir(tmp_path)
    cut_out(path, name, low, high)
    (tmp_path / "room.yaml").write_text(rooms[name])
    scene = bn.load_scene("room.yaml")
    plan = bn.make_plan(scene, planner="greedy-stops")
    outcome = jax.device_get(bn.execute(scene, plan))
    assert int(outcome.grasped) == len(scene.names)
    robot = load_robot(scene.robot)
    motion = plan_motion(robot, scene.arrays, plan, outcome)
    poses = np.array([motion.at(time)[0] for time in np.arange(0.0, motion.time[-1], 0.05)])
    points, half = closed_points(path), np.asarray(robot.footprint_half_size)
    for x, y, heading in np.unique(poses, axis=0):
        away = points - (x, y)
        along = away @ [np.cos(heading), np.sin(heading)]
        across = away @ [-np.sin(heading), np.cos(heading)]
        assert not np.any((np.abs(along) < half[0] + KEPT_M) & (np.abs(across) < half[1] + KEPT_M))
