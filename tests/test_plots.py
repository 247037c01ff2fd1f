"""Pictures are drawn, and show what they should."""

import dataclasses
import io
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.patches import Polygon

from basenet_jax.plots import plot_plan
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.generate import draw_scene

STOPS = jnp.array([[0.3, -0.9, 0.1], [0.3, -0.9, 0.1], [0.5, 0.95, 3.0], [0.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def scene(table):
    return draw_scene(jax.random.key(2), 3, table, slots=4)[0]


def plan_and_outcome(feasible):
    is_step = jnp.array([True, True, True, False])
    plan = Plan(jnp.array([2, 0, 1, -1]), STOPS, is_step, jnp.zeros(4, int))
    times = jnp.array([6.0, 0.0, 12.0, 0.0])
    ok = jnp.array([*feasible, False])
    return plan, Outcome(is_step, ok, jnp.where(ok, 0, 2), times, 9.0 * ok, jnp.zeros((4, 5, 6)))


def texts(figure):
    return [text.get_text() for text in figure.axes[0].texts]


def test_a_plan_is_drawn_with_shared_stops_numbers_and_totals(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, True, True]))
    assert {"start", "1, 2", "3"} <= set(texts(figure))
    assert figure.axes[0].get_title() == "3 of 3 objects grasped, N 18.0 s + G 27.0 s = 45.0 s"
    rectangles = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    assert len(rectangles) == 1 + 3 + 3, "table, objects, start and two stops"


def test_what_is_not_grasped_says_so(robot, scene):
    figure = plot_plan(robot, scene, *plan_and_outcome([True, False, True]))
    assert "2 not grasped" in texts(figure)


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
