"""The picture of one plan shows what it should."""

import dataclasses
import io
import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from basenet_jax.plots import plot_plan
from basenet_jax.plots.arm_reach import arm_reach
from basenet_jax.plots.drawing import FAILED, draw_room, short_list, to_world
from basenet_jax.task.picking import Reason, pick
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.grasps import from_the_side, of_objects, top_down
from tests.regrasp import regrasp

STOPS = jnp.array([[0.3, -0.9, 0.1], [0.3, -0.9, 0.1], [0.5, 0.95, 3.0], [0.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def scene(room):
    return draw_scene(jax.random.key(2), 3, room, slots=4)[0]


def plan_and_outcome(feasible):
    is_step = jnp.array([True, True, True, False])
    plan = Plan(jnp.array([2, 0, 1, -1]), STOPS, is_step, jnp.zeros(4, int))
    times = jnp.array([6.0, 0.0, 12.0, 0.0])
    ok = jnp.array([*feasible, False])
    return plan, Outcome(is_step, ok, jnp.where(ok, 0, 2), times, 9.0 * ok, jnp.zeros((4, 5, 6)), ok - 1)


def steps_beside(figure):
    return figure.texts[0].get_text().splitlines()


def texts(figure):
    return [text.get_text() for text in figure.axes[0].texts]


def test_a_plan_is_drawn_with_shared_stops_numbers_and_totals(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, True, True]))
    assert {"start", "1, 2", "3"} <= set(texts(figure))
    assert figure.axes[0].get_title() == "3 of 3 objects grasped, N 18.0 s + G 27.0 s = 45.0 s"
    rectangles = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    assert len(rectangles) == 1 + 3 + 3, "table, objects, start and two stops"
    assert [line.split()[-2:] for line in steps_beside(figure)[1:]] == [["6.0", "9.0"], ["0.0", "9.0"], ["12.0", "9.0"]]


def test_of_many_grasps_the_one_that_is_used_is_drawn_and_the_way_it_comes(robot, scene):
    """Of one from above, as always, the gripper alone."""
    side = from_the_side(3, 0.2)
    many = dataclasses.replace(scene, object_grasps=of_objects([side] * 4))
    plan, outcome = plan_and_outcome([True, True, False])
    outcome = dataclasses.replace(outcome, grasp=jnp.array([2, 1, -1, -1]))
    drawn: list[Any] = [line.get_xydata() for line in plot_plan(robot, many, plan, outcome).axes[0].lines]
    long = [
        line for line in drawn if len(line) == 2 and np.ptp(line, axis=0).max() > 0.01
    ]  # a level gripper's is a dot
    used = {2: 2, 0: 1, 1: 0}  # slot: grasp; the one that fails keeps its first
    tools = np.asarray(many.grasps.pose)[:, :, :2]
    for slot, index in used.items():
        way = [line for line in long if np.allclose(line[0], tools[slot, index], atol=1e-5)]
        assert len(way) == 1
        centre = np.asarray(scene.object_pose)[slot, :2]
        along = way[0][1] - tools[slot, index]
        assert along @ (centre - tools[slot, index]) == pytest.approx(0.25 * 0.2, abs=1e-4), "towards the object"
    ends = [line[1] for line in long]
    assert sum(np.allclose(end, tools[2, 2], atol=1e-5) for end in ends) == 1, "the pick's line leads there"
    alone = plot_plan(robot, scene, *plan_and_outcome([True, True, True])).axes[0].lines
    assert len(alone) == len(drawn) - 3 - 1 + 1, "three ways and the cross less, a pick more"


def test_names_stand_in_the_list_of_steps_long_ones_cut(robot, scene):
    names = ["first", "second", "the third one of all of them"]
    figure = plot_plan(robot, scene, *plan_and_outcome([True, True, True]), "a title", names=names)
    lines = steps_beside(figure)
    assert "the third one of …" in lines[1]
    assert "first" in lines[2]
    assert figure.axes[0].get_title() == "a title"


def test_the_reach_is_drawn_round_each_stop_and_only_on_the_table(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, True, True]))
    discs = [artist for artist in figure.axes[0].get_children() if isinstance(artist, Circle)]
    mounts = [to_world(pose, robot.mount_position[None, :2])[0] for pose in (STOPS[0], STOPS[2])]
    np.testing.assert_allclose([disc.center for disc in discs], mounts, atol=1e-5)
    assert all(disc.get_clip_path() is not None for disc in discs)


def test_the_reach_is_where_inverse_kinematics_ends(robot, room):
    height = 1.1
    reach = arm_reach(robot, height)
    assert reach is not None
    nearest, farthest = reach
    assert nearest < 0.3
    assert 0.7 < farthest < 1.0
    x, y = robot.mount_position[:2] + np.array([0.0, 3.0])  # far from the table, so that only the arm decides
    grasps = jnp.array([[x - distance, y, height, 0.0] for distance in (farthest - 0.01, farthest + 0.02)])
    picks = jax.jit(pick)(robot, jnp.array([0.0, 3.0, 0.0]), top_down(grasps), room)
    np.testing.assert_array_equal(picks.reason, [Reason.NONE, Reason.OUT_OF_REACH])


@pytest.mark.parametrize("height", [3.0, -0.79])
def test_no_reach_at_a_height_is_no_error(robot, height):
    assert arm_reach(robot, height) is None


@pytest.mark.parametrize("grasped", [True, False])
def test_an_object_below_the_lowest_reach_has_no_part_in_the_reach(robot, scene, grasped):
    """A plan that leaves it on the table is a plan, and so is one that grasps nothing at all."""
    low = regrasp(scene, lambda pose: pose[1, :, 2].fill(-1.6))
    plan, outcome = plan_and_outcome([grasped, grasped, False])
    assert arm_reach(robot, float(np.min(np.asarray(low.first_grasp)[:3, 2]))) is None
    discs, usual = (
        [
            artist
            for artist in plot_plan(robot, each, plan, outcome).axes[0].get_children()
            if isinstance(artist, Circle)
        ]
        for each in (low, scene)
    )
    assert len(discs) == len(usual) == (2 if grasped else 0)
    assert [disc.radius for disc in discs] == [disc.radius for disc in usual]


@pytest.mark.parametrize(
    ("numbers", "text"), [([1], "1"), ([1, 2], "1, 2"), ([1, 2, 3], "1-3"), ([1, 3, 4, 5, 9], "1, 3-5, 9")]
)
def test_runs_of_numbers_are_shortened(numbers, text):
    assert short_list(numbers) == text


def test_fifty_steps_fit_on_the_picture(robot, room):
    many, _ = draw_scene(jax.random.key(0), 50, room)
    index = jnp.arange(50)
    poses = jnp.tile(STOPS[0], (50, 1))
    plan = Plan(index, poses, jnp.ones(50, bool), jnp.zeros(50, int))
    ok = jnp.ones(50, bool)
    figure = plot_plan(
        robot, many, plan, Outcome(ok, ok, 0 * index, 0.0 * index, 9.0 * ok, jnp.zeros((50, 5, 6)), 0 * index)
    )
    figure.draw_without_rendering()
    box = figure.texts[0].get_window_extent()
    assert box.y0 >= 0
    assert box.x1 <= figure.bbox.x1


def test_what_is_not_grasped_says_so(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, False, True]))
    crosses = [line for line in figure.axes[0].lines if line.get_marker() == "x"]
    assert [line.get_color() for line in crosses] == [FAILED]
    number = next(text for text in figure.axes[0].texts if text.get_text() == "2")
    assert number.get_color() == FAILED
    assert "out_of_reach" in steps_beside(figure)[2]
    assert "not grasped" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_drawn_path_stays_off_the_table(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, True, True]))
    drives = [np.asarray(line.get_xydata()) for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert len(drives) == 2
    for path in drives:
        points = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)])
        assert not np.any((np.abs(points[:, 0]) < 1.24) & (np.abs(points[:, 1]) < 0.64))


def test_the_picture_is_readable_in_size_and_not_blank(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, True, True]))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="rgba", dpi=50)
    pixels = np.frombuffer(buffer.getvalue(), np.uint8).reshape(-1, 4)
    assert 0.02 < np.mean(np.any(pixels[:, :3] < 250, axis=1)) < 0.6


def test_users_own_classes_have_a_colour_and_a_name(robot, scene):
    own = dataclasses.replace(scene, object_class=jnp.full(4, -1))
    figure = plot_plan(robot, own, *plan_and_outcome([True, True, True]))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "own class" in labels
    assert "mug" not in labels


def test_a_map_is_one_shape_and_what_stands_there_is_seen():
    """Its rectangles reach far beyond the table that the plan is for."""
    count = 300
    pose = np.column_stack([np.linspace(-40, 40, count), np.full(count, 3.0), np.zeros(count)])
    half_size, flat = np.full((count, 2), 0.1), np.arange(count) > 0
    pose[0], half_size[0] = (1.0, 2.0, 0.0), (0.6, 0.3)
    leaves: dict[str, Any] = {
        "pose": pose,
        "half_size": half_size,
        "low": np.zeros(count),
        "high": np.where(flat, 0.01, 0.8),
        "blocks_base": np.ones(count, bool),
        "blocks_arm": ~flat,
        "bears_objects": ~flat,
    }
    floor: Any = np.array(UNBOUNDED)
    axes = Figure().add_subplot()
    draw_room(axes, Room(Boxes(**leaves), floor))
    axes.autoscale_view()
    assert len(axes.patches) + len(axes.artists) == 2
    low, high = axes.get_xlim()
    assert (-3.0 < low < -1.0, 3.0 < high < 5.0) == (True, True)
