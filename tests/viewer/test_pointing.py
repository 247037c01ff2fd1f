import numpy as np
import pytest

from basenet_jax.viewer.execution import frame_at
from basenet_jax.viewer.pointing import Target, hit, meet_box, meet_plane, pose_of

EYE = np.array([0.3, -4.0, 3.0])


def test_a_ray_meets_a_plane_where_it_should():
    place = meet_plane(EYE, np.array([0.5, -1.0, 0.75]) - EYE, 0.75)
    assert place == pytest.approx([0.5, -1.0])


@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (0.0, 1.0, 0.3), (1.0, 0.0, -1e-6)])
def test_a_ray_that_doesnt_go_down_meets_no_plane(direction):
    assert meet_plane(EYE, direction, 0.0) is None


def test_nothing_above_the_eye_is_met():
    assert meet_plane(EYE, (0.0, 0.0, -1.0), 3.5) is None


@pytest.mark.parametrize("seed", range(20))
def test_rays_against_boxes_agree_with_points_along_the_ray(seed):
    """A ray meets a box exactly if a point along it, of many, is inside."""
    rng = np.random.default_rng(seed)
    frame, half = frame_at((*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)), rng.uniform(0, 1)), rng.uniform(0.2, 0.6, 3)
    for _ in range(20):
        direction = rng.uniform([-1.5, -1.5, -1.0], [1.5, 1.5, 2.0]) - EYE
        along = np.linspace(0.0, 3.0, 20_001)
        points = (EYE + along[:, None] * direction - frame[:3, 3]) @ frame[:3, :3]
        inside = np.all(np.abs(points) <= half, axis=1)
        met = meet_box(EYE, direction, frame, half)
        grazing = np.any(np.all(np.abs(points) <= half + 1e-3, axis=1)) != inside.any()
        if grazing:
            continue
        assert (met is not None) == inside.any()
        if met is not None:
            assert met == pytest.approx(along[np.argmax(inside)], abs=2e-4)


def test_the_mouse_finds_objects_the_start_and_the_floor(scene):
    def at(*point):
        return hit(scene, EYE, np.array(point) - EYE)

    for slot, name in enumerate(scene.names):
        x, y, _ = scene.arrays.object_pose[slot]
        assert at(x, y, 0.8) == (Target(name), None)
    x, y, _ = scene.arrays.robot_start
    assert at(x, y, 0.5) == (Target(None), None)
    target, floor = at(0.9, -1.5, 0.0)
    assert target is None
    assert floor == pytest.approx((0.9, -1.5))
    assert at(-0.5, 0.0, 0.75) == (None, None), "the table is neither"
    assert at(0.0, 0.9, 0.0) == (None, None), "it hides the floor behind it"


def test_poses_of_what_can_be_moved(scene):
    assert pose_of(scene, Target("mug_2")) == pytest.approx([0.4, -0.25, 0.8])
    assert pose_of(scene, Target(None)) == pytest.approx([2.6, -0.5, 1.0])
