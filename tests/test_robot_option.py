"""`--robot` in the commands, and what scenes, plans and weights say of their robot."""

import json

import jax
import pytest
import yaml

from basenet_jax import api, generate, plan, train
from basenet_jax.evaluation.preparation import Request, prepare
from basenet_jax.planners import registry
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.policies.trained import load_policies
from basenet_jax.robot.reading import RobotFileError, load_robot
from basenet_jax.world.scene_file import SceneFileError, load_scene
from tests.robot.conftest import ASSETS
from tests.scene_texts import TEXT, park_once

UNNAMED = TEXT.replace("model: ur5e_mobile, ", "")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a scene, and a robot of one's own called `mine`, whose base is twice as long."""
    content = yaml.safe_load((ASSETS / "ur5e_mobile.yaml").read_text())
    content |= {"name": "mine", "base": content["base"] | {"footprint": [1.6, 0.5]}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(content))
    (tmp_path / content["model"]).write_text((ASSETS / content["model"]).read_text())
    (tmp_path / "scene.yaml").write_text(TEXT)
    (tmp_path / "unnamed.yaml").write_text(UNNAMED)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def setups(monkeypatch):
    """What planners were made for; planning costs nothing."""
    made = []

    def make(name, setup, options):
        del name, options
        made.append(setup)
        return park_once

    monkeypatch.setattr(registry, "make_planner", make)
    api._planner.cache_clear()
    yield made
    api._planner.cache_clear()


@pytest.mark.parametrize("robot", ["ur10e_mobile", "mine.yaml"])
def test_plan_takes_the_robot_that_is_asked_for(folder, setups, capsys, robot):
    code = plan.main(["scene.yaml", "--planner", "dp", "--robot", robot, "--out", "plan.json"])
    out, err = capsys.readouterr()
    name = load_robot(robot).name
    assert code in (0, 3), err
    assert setups[0].robot.name == name
    assert json.loads((folder / "plan.json").read_text())["robot"] == name
    assert "names the robot ur5e_mobile, not this" in err
    assert "planned by dp" in out


def test_a_scene_that_names_no_robot_takes_any_without_a_word(folder, setups, capsys):
    plan.main(["unnamed.yaml", "--planner", "dp", "--robot", "ur10e_mobile"])
    plan.main(["unnamed.yaml", "--planner", "dp"])
    assert [setup.robot.name for setup in setups] == ["ur10e_mobile", "ur5e_mobile"]
    assert "names the robot" not in capsys.readouterr().err


def test_the_start_is_checked_for_the_robot_that_is_used(folder):
    """0.75 m from the table's edge, pointing at it: 0.35 m clear with a base of 0.8 m, too near with one of 1.6 m."""
    near = UNNAMED.replace("[2.4, -1.1, 1.57]", "[0.0, -1.15, 1.5707963]")
    (folder / "near.yaml").write_text(near)
    assert load_scene("near.yaml").robot == "ur5e_mobile"
    with pytest.raises(SceneFileError, match=r"robot\.start: found .*, where the base of mine touches the table"):
        load_scene("near.yaml", robot="mine.yaml")


def test_a_scene_for_a_robot_of_ones_own_needs_its_file(folder, setups, capsys):
    assert generate.main(["--robot", "mine.yaml", "--count", "1", "--objects", "2", "--out", "scenes"]) == 0
    scene = "scenes/scene-0000.yaml"
    assert yaml.safe_load((folder / scene).read_text())["robot"]["model"] == "mine"
    capsys.readouterr()
    assert plan.main([scene, "--planner", "dp"]) == 2
    assert "robot.model: found 'mine', allowed are panda_mobile," in (err := capsys.readouterr().err)
    assert "given by its file as --robot" in err
    assert plan.main([scene, "--planner", "dp", "--robot", "mine.yaml"]) in (0, 3)
    assert "names the robot" not in capsys.readouterr().err


def test_the_library_plans_with_the_robot_file_as_it_is_now(folder, setups):
    scene = load_scene("unnamed.yaml", robot="mine.yaml")
    for _ in range(2):
        api.make_plan(scene, planner="dp")
    assert [float(setup.robot.footprint_half_size[0]) for setup in setups] == pytest.approx([0.8]), "made once"
    (folder / "mine.yaml").write_text((folder / "mine.yaml").read_text().replace("- 1.6\n", "- 1.2\n"))
    api.make_plan(scene, planner="dp")
    assert float(setups[-1].robot.footprint_half_size[0]) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        (plan, ["scene.yaml"]),
        (generate, ["--out", "scenes"]),
        (train, ["--run-dir", "run"]),
    ],
)
def test_wrong_robots_are_refused_before_any_work(folder, capsys, command, arguments):
    (folder / "broken.yaml").write_text("format: basenet-robot/2\n")
    for robot, message in (("ur6e", "robot: found 'ur6e', allowed are panda_mobile"), ("broken.yaml", "format: found")):
        assert command.main([*arguments, "--robot", robot]) == 2
        assert message in capsys.readouterr().err
    assert not (folder / "run").exists()


def test_evaluation_takes_the_robot(folder):
    request = Request(folder / "out", (2,), 1, ("greedy-stops",), None, 0, 1, robot="mine.yaml")
    planners, _, about = prepare(request, [])
    assert planners.setup.robot.name == about["robot"] == "mine"
    (folder / "scenes").mkdir()
    (folder / "scenes" / "scene.yaml").write_text(TEXT)
    request = Request(folder / "out", None, None, ("greedy-stops",), folder / "scenes", 0, 1, robot="mine.yaml")
    assert prepare(request, [])[0].setup.robot.name == "mine"


@pytest.mark.parametrize("planner", ["basenet", "basenet-sample", "basenet-paper"])
def test_weights_of_another_robot_are_refused(planner):
    setup = PlannerSetup(robot=jax.device_put(load_robot("ur10e_mobile")))
    message = "found weights for the robot 'ur5e_mobile', needed are some for 'ur10e_mobile': train them"
    with pytest.raises(ValueError, match=message):
        registry.make_planner(planner, setup)


def test_the_packaged_weights_are_for_the_default_robot():
    assert load_policies().base_pose.frame == "object"


def test_a_refused_robot_file_is_named_by_the_library(folder):
    (folder / "broken.yaml").write_text("{")
    with pytest.raises(RobotFileError, match=r"broken\.yaml: "):
        load_robot("broken.yaml")
