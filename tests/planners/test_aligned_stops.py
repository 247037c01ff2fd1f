import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import AlignedConfig, UncertaintyConfig
from basenet_jax.planners.aligned_stops import aligned_poses, sure_lines
from basenet_jax.task.reliability import Chance
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


def test_farther_lines_are_the_same_stops_from_a_greater_distance(robot):
    near, far = AlignedConfig(gap_m=1e-3), AlignedConfig(gap_m=0.051)
    both = aligned_poses(robot, TABLES[0], AlignedConfig(gap_m=1e-3, farther_m=(0.05,)))
    alone = np.concatenate([aligned_poses(robot, TABLES[0], each) for each in (near, far)])
    np.testing.assert_allclose(both, alone, atol=1e-6)


@pytest.mark.parametrize("level", [0.8, 1.0])
def test_lines_for_errors_keep_the_base_clear_as_often_as_they_say(robot, level):
    uncertainty = UncertaintyConfig(sd_xy_m=0.05, sd_heading_rad=0.08, base_clearance_m=0.1)  # as the compiled test
    chance = Chance.of(uncertainty, level)
    aligned = sure_lines(robot, chance, AlignedConfig())
    x, errors = np.zeros(64), np.asarray(chance.errors.base, float)
    (length, width), half = np.asarray(robot.footprint_half_size), 0.4
    fails = []
    for turned, beside in ((0.0, width), (np.pi / 2, length)):
        for side in (-1.0, 1.0):
            y = side * (half + 0.1 + aligned.gap_m + beside)
            sine, cosine = np.sin(turned), np.cos(turned)
            poses = np.column_stack(
                [
                    x + cosine * errors[:, 0] - sine * errors[:, 1],
                    y + sine * errors[:, 0] + cosine * errors[:, 1],
                    turned + errors[:, 2],
                ]
            )
            fails.append(np.sum(base_collides(robot, poses, TABLES[0])))
    assert max(fails) <= int(chance.allowed) // 2
    assert aligned.farther_m == (0.05,)
    # No farther than that: 3 cm nearer, more would fail from one side or the other.
    assert aligned.gap_m < 0.3


def test_small_errors_need_no_other_lines(robot):
    chance = Chance.of(UncertaintyConfig(sd_xy_m=0.01, sd_heading_rad=0.01), 1.0)
    assert sure_lines(robot, chance, AlignedConfig()) == AlignedConfig()
