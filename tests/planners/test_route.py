import jax
import numpy as np

from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.planners.route import as_plan, as_route, reason_by_slot
from basenet_jax.task.picking import Reason

HERE, THERE = (0.0, -1.0, 0.0), (0.5, -1.0, 0.0)


def plan_of(scene, order, poses):
    return assemble_plan(scene, np.array(order), np.array(poses), np.full(len(scene.mask), Reason.ARM_COLLIDES))


def test_steps_from_one_pose_are_one_stop(four_objects):
    route = as_route(plan_of(four_objects, [2, 0, 3], [HERE, HERE, THERE]))
    np.testing.assert_allclose(route.stops, [HERE, *[THERE] * 5])
    assert np.asarray(route.stop_of).tolist() == [0, -1, 0, 1, -1, -1]


def test_coming_back_to_a_pose_is_another_stop(four_objects):
    route = as_route(plan_of(four_objects, [0, 1, 2], [HERE, THERE, HERE]))
    np.testing.assert_allclose(route.stops[:3], [HERE, THERE, HERE])
    assert np.asarray(route.stop_of).tolist() == [0, 1, 2, -1, -1, -1]


def test_a_plan_comes_back_in_its_order(four_objects):
    plan = plan_of(four_objects, [2, 0, 3], [HERE, HERE, THERE])
    back = as_plan(four_objects, as_route(plan), reason_by_slot(plan))
    assert np.asarray(back.object_index).tolist() == [2, 0, 3, 1, -1, -1]
    for one, other in zip(jax.tree.leaves(plan), jax.tree.leaves(back), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_stop_without_objects_is_passed_by(four_objects):
    route = as_route(plan_of(four_objects, [0, 1, 2, 3], [HERE, THERE, THERE, HERE]))
    moved = route._replace(stop_of=route.stop_of.at[1:3].set(0))
    plan = as_plan(four_objects, moved, np.zeros(6, int))
    np.testing.assert_allclose(plan.base_pose[:4], [HERE] * 4)
