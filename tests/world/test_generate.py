"""Random scenes obey the sampling rules, for every number of objects."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_problem, draw_scene, footprint_radius
from basenet_jax.world.grasps import of_class
from basenet_jax.world.scene import MAX_OBJECTS, OBJECT_CLASSES


@pytest.fixture(scope="module")
def draw(room):
    """Scenes by key and number of objects, all in 50 slots: one program for every number."""
    chex.clear_trace_counter()

    def one(key, count):
        return draw_scene(key, count, room, own_class_share=0.2)

    return jax.jit(jax.vmap(chex.assert_max_traces(one, n=1)))


def check_rules(scene, count):
    mask = np.asarray(scene.mask)
    assert mask.sum() == count
    position = np.asarray(scene.object_pose)[mask, :2]
    radius = np.asarray(footprint_radius(scene.object_size))[mask]
    assert np.all(np.abs(position) <= np.array([1.0, 0.4]) - 0.08)
    distance = np.linalg.norm(position[:, None] - position[None], axis=-1) + 10 * np.eye(count)
    assert np.all(distance >= radius[:, None] + radius[None] - 1e-5), "objects overlap"
    start = np.asarray(scene.robot_start)
    assert 2.5 <= np.hypot(start[0], start[1]) <= 3.0


def test_scenes_are_valid_for_every_number_of_objects(draw):
    counts = jnp.arange(1, MAX_OBJECTS + 1, dtype=jnp.int32)
    scenes, placed = draw(jax.random.split(jax.random.key(0), MAX_OBJECTS), counts)
    assert bool(jnp.all(placed))
    for row, count in enumerate(counts):
        check_rules(jax.tree.map(lambda x, row=row: x[row], scenes), int(count))


def test_classes_sizes_and_grasps_are_those_of_the_table_of_objects(draw):
    scenes, _ = draw(jax.random.split(jax.random.key(1), MAX_OBJECTS), jnp.full(MAX_OBJECTS, 20, jnp.int32))
    index = np.asarray(scenes.object_class)
    for number, kind in enumerate(OBJECT_CLASSES):
        of_kind = index == number
        assert of_kind.any()
        np.testing.assert_allclose(np.asarray(scenes.object_size)[of_kind] - np.array(kind.size), 0.0, atol=1e-6)
    own = np.asarray(scenes.object_size)[index == -1]
    assert 0.1 < (index == -1).mean() < 0.3
    assert len(np.unique(own, axis=0)) == len(own)


def test_grasps_stand_where_the_design_says():
    """A mug at the origin, turned by 90 degrees: tool0 is 0.06 m behind its centre and 0.30 m above."""
    room = Room.from_config()
    scene, _ = draw_scene(jax.random.key(0), 1, room, slots=1)
    mug = OBJECT_CLASSES[3]
    scene = dataclasses.replace(
        scene,
        object_pose=jnp.array([[0.0, 0.0, jnp.pi / 2]]),
        object_size=jnp.array([mug.size]),
        object_grasps=of_class(jnp.array([[mug.grasp_x, mug.grasp_z, mug.grasp_yaw]])),
    )
    np.testing.assert_allclose(scene.first_grasp[0], [0.0, -0.06, 0.75 + 0.041 + 0.30, np.pi / 2], atol=1e-6)


def test_too_many_objects_for_a_table_are_reported_not_squeezed_in():
    small = Room.of_table(half_size=jnp.array([0.2, 0.15]), height=jnp.array(0.75))
    _, placed = jax.jit(lambda key: draw_scene(key, 30, small, slots=30))(jax.random.key(0))
    assert not bool(placed)


def test_positions_are_uniform(draw):
    """A lone object's place has the mean and spread of a uniform distribution (5 standard errors)."""
    x = []
    for seed in range(6):
        scenes, _ = draw(jax.random.split(jax.random.key(100 + seed), MAX_OBJECTS), jnp.full(MAX_OBJECTS, 1, jnp.int32))
        x.append(np.asarray(scenes.object_pose)[np.asarray(scenes.mask)])
    pose = np.concatenate(x)
    for column, half in ((0, 0.92), (1, 0.32), (2, np.pi)):
        spread = half / np.sqrt(3)
        assert abs(pose[:, column].mean()) < 5 * spread / np.sqrt(len(pose))
        assert abs(pose[:, column].std() / spread - 1) < 0.2


def test_problems_mix_classes_and_own_objects(robot, room):
    draw = jax.jit(jax.vmap(lambda key: draw_problem(key, robot, room, own_class_share=0.5)))
    grasps, _ = draw(jax.random.split(jax.random.key(5), 400))
    heights = {round(0.75 + kind.size[2] / 2 + kind.grasp_z, 4) for kind in OBJECT_CLASSES}
    of_class = np.array([round(float(z), 4) in heights for z in grasps[:, 2]])
    assert 0.4 < of_class.mean() < 0.6
