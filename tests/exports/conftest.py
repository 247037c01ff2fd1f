import jax
import numpy as np
import pytest

from basenet_jax.exports import make_schedule
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.plan import execute
from basenet_jax.world.scene import NamedScene
from tests import judged

TABLE_POSE = (1.5, -2.0, 2.5)  # m, m, rad


@pytest.fixture(scope="session")
def scene():
    return NamedScene(judged.first(judged.scenes()), ("mug_1", "mug_2"), "ur5e_mobile")


@pytest.fixture(scope="session")
def plan():
    return judged.first(judged.plans())


@pytest.fixture(scope="session")
def outcome():
    return judged.first(judged.outcomes())


@pytest.fixture(scope="session")
def schedule(robot, scene, plan, outcome):
    return make_schedule(robot, scene, plan, outcome, table_pose=TABLE_POSE, map_frame="hall")


@pytest.fixture(scope="session")
def panda_schedule(plan):
    robot = load_robot("panda_mobile")
    scene = NamedScene(judged.first(judged.scenes()), ("mug_1", "mug_2"), robot.name)
    plan = plan.replace(base_pose=np.tile(np.array([0.3, -0.8, 0.0], np.float32), (2, 1)))
    outcome = jax.device_get(jax.jit(execute)(robot, scene.arrays, plan))
    assert outcome.feasible.all(), "the base pose is not what these tests need"
    return make_schedule(robot, scene, plan, outcome)
