"""The shelf of the documentation: three boards, and grasps from the front alone."""

from pathlib import Path

import jax
import numpy as np
import pytest

from basenet_jax.evaluation.replay import replay
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import judge
from basenet_jax.world.scene_file import load_scene

SHELF = Path(__file__).parents[2] / "docs" / "examples" / "shelf.yaml"


@pytest.fixture(scope="module")
def shelf():
    return load_scene(SHELF)


def test_all_grasps_are_from_the_front(shelf):
    """R = Rz(yaw) Ry(pitch) Rx(roll) turns z to (0, 1, 0), into the shelf."""
    assert len(shelf.names) == 12
    grasps = jax.device_get(shelf.arrays.grasps)
    roll, pitch, yaw = grasps.pose[grasps.there][:, 3:].T
    into = np.stack(
        [
            np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll),
            np.sin(yaw) * np.sin(pitch) * np.cos(roll) - np.cos(yaw) * np.sin(roll),
            np.cos(pitch) * np.cos(roll),
        ],
        axis=-1,
    )
    np.testing.assert_allclose(into, np.broadcast_to([0.0, 1.0, 0.0], into.shape), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["greedy-stops", "basenet", "refined"])
def test_everything_is_picked_and_mujoco_agrees(name, shelf):
    setup = PlannerSetup(robot=jax.device_put(load_robot()), room=shelf.arrays.room)
    plan = make_planner(name, setup)(shelf.arrays, jax.random.key(0))
    outcome = judge(setup.robot, shelf.arrays, plan, setup.world)
    assert int(outcome.grasped) == 12
    batch = jax.tree.map(lambda x: np.asarray(x)[None], jax.device_get((shelf.arrays, plan, outcome)))
    np.testing.assert_array_equal(replay(load_robot(), *batch), Reason.NONE)
