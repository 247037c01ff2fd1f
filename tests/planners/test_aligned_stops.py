import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import AlignedConfig
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.world.boxes import Room
from tests.compiled import base_collides

TABLES = [Room.from_config(), Room.of_table(jnp.array([0.3, 0.9]), jnp.array(0.6))]


@pytest.mark.parametrize("room", TABLES)
def test_stops_are_as_near_to_the_table_as_is_allowed(robot, room):
    poses = aligned_poses(robot, room, AlignedConfig(step_m=0.25, gap_m=1e-3))
    assert not np.any(base_collides(robot, poses, room))
    inside = np.abs(poses[:, :2]) < np.asarray(room.table_half_size)
    for axis in (0, 1):
        beside = inside[:, 1 - axis]  # those that face a side, not a corner
        nearer = poses[beside]
        nearer[:, axis] -= np.sign(nearer[:, axis]) * 2e-3
        assert len(nearer) >= 8
        assert np.all(base_collides(robot, nearer, room))


def test_they_are_the_same_seen_from_the_other_side(robot):
    """Turning the table by pi changes nothing, so it must not change the stops."""
    poses = aligned_poses(robot, TABLES[0]).astype(float)
    turned = poses * np.array([-1.0, -1.0, 1.0]) + np.array([0.0, 0.0, np.pi])

    def features(poses):
        heading = poses[:, 2:]
        rows = np.round(np.concatenate([poses[:, :2], np.cos(heading), np.sin(heading)], axis=1), 3) + 0.0
        return {tuple(row) for row in rows}

    assert features(turned) == features(poses)


def test_a_finer_step_gives_more(robot):
    fine, coarse = (aligned_poses(robot, TABLES[0], AlignedConfig(step_m=step)) for step in (0.1, 0.2))
    assert len(fine) > 1.8 * len(coarse)
    assert {tuple(row) for row in np.round(coarse, 4)} <= {tuple(row) for row in np.round(fine, 4)}
