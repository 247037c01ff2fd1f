"""Grasps that a detector found for scanned objects, brought in as the documentation says, planned and judged."""

import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest
import yaml

import basenet_jax as bn
from basenet_jax.evaluation.replay import replay
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Reason
from basenet_jax.world.scene_file import SceneFileError
from tests.shared_data import shared_file

DOCS = Path(__file__).parents[2] / "docs/rooms.md"
# Names, and sizes (m) of boxes about the objects as they lie there, whatever their yaw is called.
SIZES = {
    "004_sugar_box": (0.04, 0.09, 0.175),
    "011_banana": (0.11, 0.19, 0.04),
    "044_flat_screwdriver": (0.16, 0.16, 0.03),
    "056_tennis_ball": (0.065, 0.065, 0.065),
}
HEIGHT = 0.72  # m, of the table that is put under them
BACK = {"position": [0.0, 0.0, 0.25], "rpy_degrees": [180.0, 0.0, 0.0]}  # at the fingertips, z back at the wrist


def in_object_frame(*arguments):
    """As the documentation has it."""
    found: dict = {}
    (code,) = (
        block for block in re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.S) if "T_room_grasps" in block
    )
    exec("\n".join(line.removeprefix("    ") for line in code.splitlines()), found)
    return found["in_object_frame"](*arguments)


def write_room(folder, tool_frame=BACK, *, own_frame=True):
    """The four objects and their 200 grasps each, on a table; centres are amid the grasps."""
    poses = yaml.safe_load(shared_file("grasps/scene.yaml").read_text())["objects"]
    objects = []
    for item in poses:
        name, size, pose = item["object_type"], SIZES[item["object_type"]], np.array(item["pose"])
        grasps = np.load(shared_file(f"grasps/grasps_{name}.npy")).astype(float)
        grasps[:, 2, 3] += HEIGHT
        middle = 0.5 * (grasps[:, :2, 3].min(axis=0) + grasps[:, :2, 3].max(axis=0))
        place = [*middle.tolist(), float(np.arctan2(pose[1, 0], pose[0, 0]))]
        np.save(folder / f"{name}.npy", in_object_frame(grasps, place, HEIGHT, size) if own_frame else grasps)
        objects.append(
            {"name": f"o{name}", "pose": place, "size": list(size), "grasps": f"{name}.npy", "tool_frame": tool_frame}
        )
    table = {"name": "table", "pose": [0.9, 1.0, 0.0], "size": [1.4, 1.3], "height": HEIGHT}
    robot = {"model": "ur5e_mobile", "start": [3.0, 1.0, 3.0]}
    floor = [-2.0, -2.0, 4.0, 4.0]
    room = {"format": "basenet-scene/2", "floor": floor, "surfaces": [table], "robot": robot, "objects": objects}
    (folder / "room.json").write_text(json.dumps(room))
    return folder / "room.json"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return bn.load_scene(write_room(tmp_path_factory.mktemp("ycb")))


def test_sixteen_of_two_hundred_are_kept_and_the_gripper_comes_from_above_or_the_side(scene):
    grasps = jax.device_get(scene.arrays.grasps)
    assert grasps.there.shape == (4, 16)
    assert np.all(grasps.there)
    for kept in scene.kept_grasps:
        assert len(set(kept)) == 16
        assert max(kept) < 200
    roll, pitch = grasps.pose[..., 3], grasps.pose[..., 4]
    down = -np.cos(pitch) * np.cos(roll)
    assert np.all(down > -1e-3)
    assert np.all(grasps.pose[..., 2] > HEIGHT)
    assert np.ptp(down, axis=1).min() > 0.5, "level ones and steep ones are among those of each object"


def test_what_is_left_out_of_the_recipe_is_said(tmp_path):
    """The frame of the room, and a frame whose z points back."""
    with pytest.raises(SceneFileError, match=r"objects\[\d\].grasps: 0.*npy: found no grasp nearer .* not a room's"):
        bn.load_scene(write_room(tmp_path, own_frame=False))
    with pytest.raises(
        SceneFileError, match=r"found grasps from below the object and none from above, .* rpy_degrees: \[180, 0, 0\]"
    ):
        bn.load_scene(write_room(tmp_path, BACK | {"rpy_degrees": [0.0, 0.0, 0.0]}))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["greedy-stops", "dp", "pbg-gc", "mbp-gc"])
def test_all_four_are_grasped_and_mujoco_agrees(scene, name):
    plan = bn.make_plan(scene, planner=name)
    outcome = jax.device_get(bn.execute(scene, plan))
    assert int(outcome.grasped) == 4
    batch = jax.tree.map(lambda x: np.asarray(x)[None], (scene.arrays, plan, outcome))
    np.testing.assert_array_equal(replay(load_robot(), *batch), Reason.NONE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pbg", "mbp"])
def test_by_the_map_all_four_are_thought_to_be_reachable(scene, name):
    """Nearly all of them can be picked too, though it knows neither the table nor the approach."""
    plan = bn.make_plan(scene, planner=name)
    assert int(np.sum(plan.served)) == 4
    assert int(bn.execute(scene, plan).grasped) >= 3
