"""Plan files: the contract's fields, the same plan back, and what is no plan of the scene."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import NavigationConfig, PickConfig, TableConfig, UncertaintyConfig, WorldConfig
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Outcome, Plan, with_singular_values
from basenet_jax.task.plan_file import PlanFileError, load_plan, load_plan_world, save_plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import of_class
from basenet_jax.world.naming import name_objects
from basenet_jax.world.scene import Scene
from tests import compiled

ABOUT = {"planner": "dp", "planning_time_s": 0.1234567890123, "compile_time_s": 2.0}


@pytest.fixture(scope="module")
def scene():
    """Four mugs in five slots."""
    x = jnp.array([-0.05, 0.1, 0.25, 0.4, 0.0])
    return name_objects(
        Scene(
            object_pose=jnp.stack([x, jnp.full(5, -0.25), jnp.linspace(0, 1, 5)], axis=-1),
            object_size=jnp.tile(jnp.array([0.08, 0.08, 0.082]), (5, 1)),
            object_grasps=of_class(jnp.tile(jnp.array([-0.06, 0.30, 0.0]), (5, 1))),
            object_class=jnp.full(5, 3),
            mask=jnp.arange(5) < 4,
            surface_height=jnp.full(5, 0.75),
            robot_start=jnp.array([2.6, -0.5, 1.0]),
            room=Room.from_config(),
        )
    )


@pytest.fixture(scope="module")
def plan():
    """Two objects picked, one from too far away, one that no pose serves."""
    good, far = [0.35, -0.9, 0.05], [-2.0, 1.5, 0.1]
    return Plan(
        object_index=jnp.array([2, 0, 3, 1, -1]),
        base_pose=jnp.array([good, good, far, [0, 0, 0], [0, 0, 0]]),
        served=jnp.array([True, True, True, False, False]),
        reason=jnp.array([0, 0, 0, int(Reason.ARM_COLLIDES), 0]),
    )


@pytest.fixture(scope="module")
def outcome(robot, scene, plan):
    return with_singular_values(robot, compiled.execute(robot, scene.arrays, plan))


@pytest.fixture
def path(tmp_path, scene, plan, outcome):
    path = tmp_path / "plan.json"
    save_plan(path, scene, plan, outcome, **ABOUT)
    return path


def test_the_file_holds_what_the_contract_says(path, outcome):
    content = json.loads(path.read_text())
    assert list(content) == ["format", "planner", "robot", "planning_time_s", "compile_time_s", "steps", "totals"]
    assert [content[key] for key in list(content)[:5]] == ["basenet-plan/1", "dp", "ur5e_mobile", 0.1234567890123, 2.0]
    steps = content["steps"]
    assert [step["object"] for step in steps] == ["mug_3", "mug_1", "mug_4", "mug_2"]
    assert [step["feasible"] for step in steps] == [True, True, False, False]
    assert [step["reason"] for step in steps] == [None, None, "out_of_reach", "arm_collides"]
    assert steps[2]["base_pose"] == [-2.0, 1.5, 0.1]
    assert steps[2]["arm"] is None
    assert (steps[3]["base_pose"], steps[3]["arm"]) == (None, None)
    assert (steps[3]["navigation_time_s"], steps[3]["pick_time_s"]) == (0.0, 0.0)


def test_numbers_give_back_the_same_float32(path, outcome: Outcome):
    content = json.loads(path.read_text())
    totals, first = content["totals"], content["steps"][0]
    assert (totals["objects"], totals["grasped"]) == (4, 2)
    for name, value in (
        ("navigation", outcome.navigation),
        ("picking", outcome.picking),
        ("execution", outcome.execution),
    ):
        assert np.float32(totals[f"{name}_s"]) == np.float32(value)
    assert np.float32(first["navigation_time_s"]) == np.float32(outcome.navigation_time[0])
    assert np.float32(first["pick_time_s"]) == np.float32(outcome.pick_time[0])
    np.testing.assert_array_equal(np.array(first["arm"]["pre_grasp"], np.float32), outcome.joints[0, 0])
    np.testing.assert_array_equal(np.array(first["arm"]["grasp"], np.float32), outcome.joints[0, -1])
    least = [step["least_singular_value"] for step in content["steps"]]
    assert least[2:] == [None, None]
    assert outcome.least_singular_value is not None
    np.testing.assert_array_equal(np.array(least[:2], np.float32), outcome.least_singular_value[:2])


def test_reliabilities_are_written_with_what_they_are_of_and_checked(tmp_path, scene, plan, outcome):
    sure = dataclasses.replace(outcome, reliability=jnp.array([1.0, 0.953125, 0.5, 0.0, 0.0]))
    file = tmp_path / "sure.json"
    about = ABOUT | {"uncertainty": UncertaintyConfig(sd_xy_m=0.05), "least_reliability": 0.9}
    save_plan(file, scene, plan, sure, **about)
    content = json.loads(file.read_text())
    assert [step["reliability"] for step in content["steps"]] == [1.0, 0.953125, 0.5, 0.0]
    assert content["uncertainty"] == dataclasses.asdict(UncertaintyConfig(sd_xy_m=0.05)) | {"least_reliability": 0.9}
    np.testing.assert_array_equal(load_plan(file, scene).object_index, plan.object_index)
    for path, value, said in (
        (("steps", 1, "reliability"), 1.5, r"steps\[1\].reliability: found 1.5, allowed is a number from 0 to 1"),
        (("uncertainty", "draws"), 0, "uncertainty.draws: found 0, allowed is a whole number from 1"),
        (("uncertainty", "sd_xy_m"), -0.1, "uncertainty.sd_xy_m: found -0.1, allowed is a number from 0"),
    ):
        wrong = json.loads(file.read_text())
        place = wrong
        for each in path[:-1]:
            place = place[each]
        place[path[-1]] = value
        (tmp_path / "wrong.json").write_text(json.dumps(wrong))
        with pytest.raises(PlanFileError, match=said):
            load_plan(tmp_path / "wrong.json", scene)


def test_a_file_without_singular_values_is_read(path, scene, plan):
    """As files were before there were any, and as they are where none were computed."""
    content = json.loads(path.read_text())
    for step in content["steps"]:
        del step["least_singular_value"]
    path.write_text(json.dumps(content))
    np.testing.assert_array_equal(load_plan(path, scene).object_index, plan.object_index)


def test_the_plan_comes_back(path, scene, plan):
    again = load_plan(path, scene)
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(plan), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture
def other_world(tmp_path, scene, plan, outcome):
    """A plan of a changed world, in a file."""
    pick = PickConfig(close_s=0.5, descent_heights_m=(0.06, 0.03))
    world = WorldConfig(navigation=NavigationConfig(straight=True), pick=pick, table=TableConfig(height_m=0.6))
    save_plan(tmp_path / "other.json", scene, plan, outcome, **ABOUT, world=world)
    return tmp_path / "other.json", world


def test_a_changed_world_is_written_and_read_again(path, other_world, scene, plan):
    file, world = other_world
    content = json.loads(file.read_text())
    assert list(content)[2:4] == ["robot", "world"]
    assert content["world"] == {
        "navigation": {"straight": True},
        "pick": {"close_s": 0.5, "descent_heights_m": [0.06, 0.03]},
    }
    assert load_plan_world(file) == dataclasses.replace(world, table=TableConfig())
    np.testing.assert_array_equal(load_plan(file, scene, world).object_index, plan.object_index)
    assert "world" not in json.loads(path.read_text())
    assert "uncertainty" not in json.loads(path.read_text())
    assert load_plan_world(path) == WorldConfig()


def test_a_plan_of_another_world_is_refused(path, other_world, scene):
    file, _ = other_world
    with pytest.raises(
        PlanFileError, match=r"other\.json: world\.navigation\.straight: found true, allowed is false, as"
    ):
        load_plan(file, scene)
    with pytest.raises(PlanFileError, match=r"plan\.json: world\.pick\.close_s: found 1\.0, allowed is 0\.5, as where"):
        load_plan(path, scene, WorldConfig(pick=PickConfig(close_s=0.5)))


def test_infinite_numbers_are_not_written(tmp_path, scene, plan, outcome):
    wrong = dataclasses.replace(outcome, pick_time=np.where(np.arange(5) == 0, np.nan, outcome.pick_time))
    with pytest.raises(ValueError, match="finite"):
        save_plan(tmp_path / "plan.json", scene, plan, wrong, **ABOUT)
    assert not list(tmp_path.iterdir())


def drop_last(content):
    content["steps"].pop()


def unserved_first(content):
    content["steps"].insert(0, content["steps"].pop())


def put(*keys_and_value):
    *keys, last, value = keys_and_value

    def change(content):
        for key in keys:
            content = content[key]
        content[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("format", "basenet-plan/2"), "format: found 'basenet-plan/2', allowed is 'basenet-plan/1'"),
        (put("robot", "fetch"), "robot: found 'fetch', allowed is the scene's, 'ur5e_mobile'"),
        (put("colour", 1), "colour: found an unknown key, allowed are format, planner, robot, world, drive_times, "),
        (put("planning_time_s", -1), "planning_time_s: found -1, allowed is a number from 0 on (s)"),
        (put("totals", "grasped", True), "totals.grasped: found true, allowed is a whole number"),
        (put("steps", 0, "object", "cup"), "steps[0].object: found 'cup', allowed are the scene's: mug_1, mug_2"),
        (put("steps", 1, "object", "mug_3"), "steps[1].object: found 'mug_3', the object of steps[0], allowed is each"),
        (put("steps", 0, "base_pose", [1, 2]), "steps[0].base_pose: found [1, 2], allowed is [x, y, heading], three"),
        (put("steps", 0, "base_pose", 1, "a"), "steps[0].base_pose[1]: found 'a', allowed is a number from -1000 to"),
        (
            put("steps", 0, "base_pose", None),
            "steps[0].feasible: found true, allowed is true only with base_pose",
        ),
        (put("steps", 0, "arm", None), "steps[0].feasible: found true, allowed is true only with base_pose"),
        (put("steps", 2, "reason", "tired"), "steps[2].reason: found 'tired', allowed are base_collides, out_of_reach"),
        (put("steps", 2, "reason", None), "steps[2].reason: found null, allowed are base_collides"),
        (put("steps", 0, "least_singular_value", -1), "steps[0].least_singular_value: found -1, allowed is a number f"),
        (put("world", {"floor": {}}), "world.floor: found an unknown key, allowed are navigation, pick"),
        (
            put("world", {"pick": {"closing": 1}}),
            "world: pick.closing: found an unknown key, allowed are pregrasp_h",
        ),
        (put("world", {"pick": {"close_s": "long"}}), "world: pick.close_s: found 'long', allowed are numbers, 0 to"),
        (put("steps", 0, "arm", {}), "steps[0].arm.pre_grasp: found nothing, allowed is a list of joint angles (rad)"),
        (drop_last, "steps: found no step for 'mug_2', allowed is one step for each object of the scene"),
        (
            unserved_first,
            "steps[1].base_pose: found a pose after a step with none, allowed are steps",
        ),
    ],
    ids=range(20),
)
def test_what_is_no_plan_of_the_scene_is_refused(path, scene, change, said):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(PlanFileError) as info:
        load_plan(path, scene)
    assert str(info.value).startswith(f"{path}: {said}")


def test_a_missing_file_is_named(tmp_path, scene):
    with pytest.raises(PlanFileError, match=r"none\.json: can't be read: No such file"):
        load_plan(tmp_path / "none.json", scene)
