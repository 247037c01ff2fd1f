"""The library's front door: scene, plan, verdict, picture."""

import dataclasses
import io
import os

import chex
import jax
import numpy as np
import pytest

import basenet_jax as bn
from basenet_jax import api
from basenet_jax.config import NavigationConfig, PickConfig, TableConfig
from basenet_jax.planners import registry
from basenet_jax.planners.options import RefinedOptions
from basenet_jax.task.plan import with_singular_values
from tests import compiled
from tests.scene_texts import TEXT, park_once


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.yaml"
    path.write_text(TEXT)
    return bn.load_scene(path)


@pytest.fixture
def asked(monkeypatch):
    """What planners were made for, with planners that cost nothing."""
    setups = []

    def make(name, setup, options):
        setups.append((name, setup, options))
        return park_once

    monkeypatch.setattr(registry, "make_planner", make)
    api._planner.cache_clear()
    yield setups
    api._planner.cache_clear()


@pytest.fixture(scope="module")
def planned(scene):
    """By the packaged weights."""
    return bn.make_plan(scene)


def test_packaged_weights_plan_a_scene(scene, planned):
    outcome = bn.execute(scene, planned)
    assert sorted(planned.object_index.tolist()) == [0, 1]
    assert int(outcome.grasped) == 2
    assert 20 < float(outcome.execution) < 200


def test_drive_times_are_tabulated_for_the_start_and_the_stops(scene, asked):
    def seconds(start, goal):
        return np.hypot(*np.moveaxis(goal[None, :, :2] - start[:, None, :2], -1, 0))

    plan = bn.make_plan(scene, planner="dp", drive_times=seconds)
    times = asked[-1][1].drive_times
    np.testing.assert_allclose(times.poses, bn.drive_poses(scene))
    np.testing.assert_allclose(times.poses[0], scene.arrays.robot_start)
    np.testing.assert_allclose(times.seconds, seconds(times.poses, times.poses))
    outcome = bn.execute(scene, plan, drive_times=seconds)
    start, stop = np.asarray(scene.arrays.robot_start), np.asarray(plan.base_pose[0])
    assert float(outcome.navigation) == pytest.approx(np.hypot(*(stop - start)[:2]), rel=1e-5)
    again = bn.execute(scene, plan, drive_times=times)
    assert int(again.grasped) == 0 or float(again.navigation) == pytest.approx(float(outcome.navigation), rel=1e-5)


def test_drive_times_of_a_file(scene, asked, tmp_path):
    table = bn.tabulate_drives(lambda start, goal: np.ones((len(start), len(goal))), bn.drive_poses(scene))
    bn.save_drive_times(tmp_path / "drives.json", table)
    bn.replan(scene, scene.arrays.robot_start, [], planner="dp", drive_times=tmp_path / "drives.json")
    found = asked[-1][1].drive_times
    assert found.source == "drives.json"
    np.testing.assert_allclose(found.seconds, table.seconds)
    with pytest.raises(ValueError, match="drive_times: found beside a planner that is made"):
        bn.make_plan(scene, planner=bn.make_planner("dp", room=scene.arrays.room), drive_times=table)


def test_the_verdict_is_the_judges(scene, planned, robot):
    expected = with_singular_values(robot, compiled.execute(robot, scene.arrays, planned))
    for given in (scene, scene.arrays):
        # Another size's program adds up in another order.
        chex.assert_trees_all_close(jax.device_get(bn.execute(given, planned)), expected, atol=1e-4)


def test_a_plan_is_drawn(scene, planned):
    buffer = io.BytesIO()
    bn.plot_plan(scene, planned).savefig(buffer, format="png")
    assert buffer.getvalue().startswith(b"\x89PNG")


def test_planners_are_made_once_for_a_robot_table_and_weights(asked, scene, tmp_path):
    for _ in range(2):
        bn.make_plan(scene, planner="dp")
        bn.make_plan(scene.arrays, planner="dp")
    assert [name for name, *_ in asked] == ["dp"]
    setup = asked[0][1]
    np.testing.assert_array_equal(setup.room.table_half_size, scene.arrays.room.table_half_size)
    bn.make_plan(scene, planner="pbg")
    low = scene.arrays.replace(room=bn.Room.of_table(scene.arrays.room.table_half_size, np.float32(0.6)))
    bn.make_plan(low, planner="dp")
    assert len(asked) == 3
    assert float(asked[2][1].room.table_height) == np.float32(0.6)
    weights = tmp_path / "a.weights"
    weights.write_bytes(b"1")
    for _ in range(2):
        bn.make_plan(scene, weights=str(weights))
    assert asked[3][2].weights == weights
    assert len(asked) == 4


def test_weights_written_anew_are_read_anew(asked, scene, tmp_path):
    weights = tmp_path / "a.weights"
    weights.write_bytes(b"1")
    bn.make_plan(scene, weights=weights)
    os.utime(weights, ns=(1, 1))
    bn.make_plan(scene, weights=weights)
    assert len(asked) == 2


def test_keys_reach_the_planner(scene, monkeypatch):
    keys = []

    def remember(scene, key):
        keys.append(key)
        return park_once(scene, key)

    monkeypatch.setattr(registry, "make_planner", lambda name, setup, options: remember)
    api._planner.cache_clear()
    bn.make_plan(scene, planner="dp")
    bn.make_plan(scene, planner="dp", key=jax.random.key(5))
    api._planner.cache_clear()
    assert [int(jax.random.key_data(key)[-1]) for key in keys] == [0, 5]


def test_an_unknown_planner_and_missing_weights_are_named(scene, tmp_path):
    with pytest.raises(ValueError, match="planner: found 'best', allowed are pbg, pbg-gc"):
        bn.make_plan(scene, planner="best")
    with pytest.raises(ValueError, match=r"none\.weights: can't be read"):
        bn.make_plan(scene, weights=tmp_path / "none.weights")


def test_random_scenes_have_named_objects_and_can_be_saved(tmp_path):
    scene = bn.sample_scene(jax.random.key(3), objects=3)
    assert len(set(scene.names)) == 3
    assert scene.arrays.mask.tolist() == [True] * 3
    path = tmp_path / "scene.json"
    bn.save_scene(path, scene)
    again = bn.load_scene(path)
    assert again.names == scene.names
    np.testing.assert_array_equal(again.arrays.object_pose, scene.arrays.object_pose)


@pytest.mark.parametrize("objects", [0, 51])
def test_a_number_of_objects_out_of_range_is_refused(objects):
    with pytest.raises(ValueError, match=f"objects: found {objects}, allowed are 1 to 50"):
        bn.sample_scene(jax.random.key(0), objects=objects)


@pytest.mark.parametrize("budget", [-1.0, float("nan"), float("inf")])
def test_a_budget_that_is_none_is_refused(scene, budget):
    with pytest.raises(ValueError, match="budget_s: found"):
        bn.make_plan(scene, planner="refined", budget_s=budget)


def test_a_number_of_samples_that_is_none_is_refused(scene):
    with pytest.raises(ValueError, match="samples: found 0"):
        bn.make_plan(scene, planner="basenet-sample", samples=0)


def test_the_budget_reaches_the_planner(asked, scene):
    bn.make_plan(scene, planner="refined", budget_s=1.5)
    assert asked[-1][2] == RefinedOptions(budget_s=1.5)


def test_what_is_left_is_planned_from_where_the_robot_stands(scene, planned):
    first = int(planned.object_index[0])
    plan = bn.replan(scene, planned.base_pose[0], [scene.names[first]])
    assert plan.object_index.tolist() == [1 - first, -1]
    again = bn.replan(scene.arrays, planned.base_pose[0].tolist(), [first])
    jax.tree.map(np.testing.assert_array_equal, plan, again)
    left = dataclasses.replace(
        scene.arrays, robot_start=planned.base_pose[0], mask=scene.arrays.mask.at[first].set(False)
    )
    outcome = bn.execute(left, plan)
    assert int(outcome.grasped) == 1
    # The rest of the old plan is one way to go on; a policy that sees where the robot stands finds none much worse.
    rest = bn.execute(scene, planned)
    assert float(outcome.execution) <= float(rest.execution - rest.navigation_time[0] - rest.pick_time[0]) + 1.0


def test_nothing_is_left(scene, planned):
    plan = bn.replan(scene, planned.base_pose[0], scene.names)
    assert plan.object_index.tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("pose", "gone", "message"),
    [
        ((0.0, -1.0, 0.0), ["nobody"], "gone: found 'nobody', allowed are"),
        ((0.0, -1.0, 0.0), [2], "gone: found 2, allowed are 0 to 1"),
        ((0.0, -1.0), [], "robot_pose: found"),
        ((0.0, float("nan"), 0.0), [], "robot_pose: found"),
    ],
)
def test_a_new_plan_that_can_not_be_made_is_refused(scene, pose, gone, message):
    with pytest.raises(ValueError, match=message):
        bn.replan(scene, pose, gone)


def test_a_planner_is_made_once_for_many_scenes(asked, scene):
    planner = bn.make_planner("refined", budget_s=1.5)
    for _ in range(2):
        assert planner(scene).object_index.tolist() == [0, 1]
        assert bn.make_plan(scene, planner=planner).object_index.tolist() == [0, 1]
    assert bn.make_planner("refined", budget_s=1.5) is planner
    assert (planner.name, planner.options) == ("refined", RefinedOptions(budget_s=1.5))
    assert len(asked) == 1
    with pytest.raises(ValueError, match="budget_s: found beside a planner that is made"):
        bn.make_plan(scene, planner=planner, budget_s=1.0)


def test_an_option_of_another_planner_is_refused_with_its_own(scene):
    with pytest.raises(ValueError, match="options of the planner dp: found samples, allowed is none"):
        bn.make_plan(scene, planner="dp", samples=7)
    with pytest.raises(ValueError, match="options of the planner basenet: found sample, allowed are weights, devices"):
        bn.make_planner("basenet", sample=7)


def test_plans_are_made_and_judged_in_the_world_that_is_asked_for(asked, scene):
    world = bn.WorldConfig(pick=PickConfig(close_s=3.0), navigation=NavigationConfig(straight=True))
    plan = bn.make_plan(scene, planner="dp", world=world)
    assert asked[-1][1].world == world
    usual, other = bn.execute(scene, plan), bn.execute(scene, plan, world=world)
    np.testing.assert_allclose(other.pick_time, usual.pick_time + 2.0, rtol=1e-5)
    assert float(other.navigation) < float(usual.navigation)
    title = bn.plot_plan(scene, plan, world=world).axes[0].get_title()
    assert f"{float(other.picking):.1f} s" in title


def test_a_robot_may_be_given_itself(asked, scene):
    named = bn.make_planner("dp", robot="ur10e_mobile")
    given = bn.make_planner("dp", robot=bn.load_robot("ur10e_mobile"))
    assert [setup.robot.name for _, setup, _ in asked] == ["ur10e_mobile"] * 2
    assert bn.make_planner("dp", robot=bn.load_robot("ur10e_mobile")) is given is not named
    plan = bn.make_plan(scene, planner="dp", robot="ur10e_mobile")
    times = [bn.execute(scene, plan, robot=robot).pick_time for robot in ("ur10e_mobile", given.setup.robot)]
    np.testing.assert_array_equal(times[0], times[1])
    assert np.any(times[0] != bn.execute(scene, plan).pick_time)


def test_scenes_are_drawn_on_the_worlds_table():
    world = bn.WorldConfig(table=TableConfig(length_m=1.0, height_m=0.6))
    one = bn.sample_scene(jax.random.key(1), objects=2, world=world).arrays
    many = bn.sample_scenes(jax.random.key(1), count=2, objects=2, world=world)
    for each in (one.room, jax.tree.map(lambda x: x[1], many.room)):
        np.testing.assert_allclose([*each.table_half_size, each.table_height], [0.5, 0.4, 0.6])
    assert float(np.max(np.abs(many.object_pose[..., 0]))) <= 0.42 + 1e-6
