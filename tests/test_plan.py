"""The plan command: what it writes and prints, its exit codes, and what it refuses before planning."""

import dataclasses
import io
import json
import math
import os
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest
import yaml

from basenet_jax import api, offscreen, plan, plots
from basenet_jax.config import UncertaintyConfig, WorldConfig
from basenet_jax.exports import schedule
from basenet_jax.planners import registry
from basenet_jax.planners.protocol import PlanningError
from basenet_jax.task import plan as judge
from basenet_jax.task.motion_check import Overlap
from basenet_jax.task.plan_file import load_plan
from basenet_jax.world.scene_file import load_scene
from tests.scene_texts import TEXT, park_once

MAKE_PLANNER = registry.make_planner
FAR = TEXT.replace("pose: [0.1, -0.2, 1.1]", "pose: [-0.9, 0.3, 1.1]")


@pytest.fixture(autouse=True)
def made(monkeypatch):
    """Planners that cost nothing; the names that were asked for."""
    names = []

    def make(name, setup, options):
        del setup, options
        names.append(name)
        return park_once

    monkeypatch.setattr(registry, "make_planner", make)
    api._planner.cache_clear()
    yield names
    api._planner.cache_clear()


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Runs the command in a folder of its own; exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(TEXT)
    (tmp_path / "far.yaml").write_text(FAR)

    def call(*arguments):
        try:
            code = plan.main(list(arguments))
        except SystemExit as end:  # tyro ends so on --help and wrong options
            code = end.code
        return code, *capsys.readouterr()

    return call


def test_a_plan_is_printed_and_written(call, made):
    code, out, err = call("scene.yaml", "--out", "plan.json", "--planner", "dp")
    assert (code, err, made) == (0, "", ["dp"])
    assert all(word in out for word in ("mug_1", "part_7", "0.35", "-0.90", "2 of 2 objects grasped", "planned by dp"))
    scene = load_scene("scene.yaml")
    assert load_plan("plan.json", scene).object_index.tolist() == [0, 1]
    with open("plan.json") as file:
        content = json.load(file)
    assert content["planner"] == "dp"
    assert content["totals"]["grasped"] == 2
    assert content["planning_time_s"] > 0
    assert content["compile_time_s"] >= 0


def test_a_pick_near_a_singular_pose_is_noted(call, monkeypatch):
    with_values = judge.with_singular_values

    def stretch(robot, outcome):
        joints = np.array(outcome.joints)
        joints[1, -1, 2] = 0.01  # the elbow, rad
        return with_values(robot, dataclasses.replace(outcome, joints=joints))

    assert "singular" not in call("scene.yaml")[1]
    monkeypatch.setattr(judge, "with_singular_values", stretch)
    code, out, _ = call("scene.yaml", "--out", "plan.json")
    assert code == 0
    [note] = [line for line in out.splitlines() if "singular" in line]
    assert note.startswith("note: part_7 is picked near a singular pose of the arm (least singular value 0.00")
    with open("plan.json") as file:
        steps = json.load(file)["steps"]
    assert steps[1]["least_singular_value"] < 0.01 < 0.02 < steps[0]["least_singular_value"]


def test_errors_reach_the_planner_and_reliabilities_the_file(call, monkeypatch):
    setups = []
    monkeypatch.setattr(registry, "make_planner", lambda name, setup, options: setups.append(setup) or park_once)
    code, out, _ = call("scene.yaml", "--uncertainty", "0.05,4", "--reliability", "0.9", "--out", "plan.json")
    assert code == 0
    assert "sure" in out
    [setup] = setups
    assert int(setup.chance.allowed) == 6
    assert setup.chance.uncertainty == UncertaintyConfig(sd_xy_m=0.05, sd_heading_rad=math.radians(4))
    with open("plan.json") as file:
        content = json.load(file)
    assert content["uncertainty"]["sd_xy_m"] == 0.05
    shares = [step["reliability"] for step in content["steps"]]
    assert all(0 < share < 0.9 for share in shares)  # it parks within a few mm of what is allowed
    notes = [line for line in out.splitlines() if line.endswith("parkings only: nothing surer was found")]
    assert notes[0] == f"note: mug_1 can be picked in {100 * shares[0]:.0f} % of parkings only: nothing surer was found"
    assert len(notes) == 2
    setups.clear()
    call("scene.yaml")
    assert setups[0].chance is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--uncertainty", "0.05"), "--uncertainty: found '0.05', allowed are 2 or 4 numbers with commas"),
        (("--uncertainty", "2cm,1"), "--uncertainty: found '2cm,1', allowed are 2 or 4 numbers with commas"),
        (("--uncertainty", "2,1"), "UncertaintyConfig.sd_xy_m: found 2.0, allowed are numbers, 0 to 0.5"),
        (("--uncertainty", "0.02,1", "--reliability", "95"), "--reliability: found 95.0, allowed are 0 to 1"),
    ],
)
def test_errors_that_are_none_are_refused(call, arguments, said):
    code, _, err = call("scene.yaml", *arguments)
    assert code == 2
    assert said in err


def test_a_planner_that_knows_no_picks_cant_plan_for_errors(call, monkeypatch):
    monkeypatch.setattr(registry, "make_planner", MAKE_PLANNER)
    code, _, err = call("scene.yaml", "--planner", "pbg", "--uncertainty", "0.02,1")
    assert code == 2
    assert "planner: found 'pbg', which can't plan for errors, allowed with these are pbg-gc" in err


def test_a_changed_world_is_in_the_plan_file(call):
    assert call("scene.yaml", "--out", "plan.json", "--world.pick.close-s", "0.5")[0] == 0
    with open("plan.json") as file:
        assert json.load(file)["world"] == {"pick": {"close_s": 0.5}}


def test_drives_in_short(call, monkeypatch):
    setups = []
    monkeypatch.setattr(registry, "make_planner", lambda name, setup, options: setups.append(setup) or park_once)
    call("scene.yaml", "--drives", "docked", "--forward-only")
    call("scene.yaml", "--world.navigation.drives", "docked", "--world.navigation.no-reverse")
    for setup in setups:
        assert (setup.world.navigation.drives, setup.world.navigation.reverse) == ("docked", False)


def test_what_the_motion_would_touch_is_noted_for_exports_and_films(call, monkeypatch):
    found = [Overlap(0, True, 0, 0.0831), Overlap(1, False, None, 0.002)]
    monkeypatch.setattr(schedule, "find_overlaps", lambda robot, room, motion: found)
    code, printed, _ = call("scene.yaml", "--export", "robot", "--export-format", "csv")
    assert code == 0
    assert "note: the base's drive for mug_1 would go 8.3 cm into table\n" in printed
    assert "note: the arm's moves for part_7 would go 0.2 cm into the robot's own body\n" in printed
    assert "--drives docked plans free ones" in printed


def test_basenet_plans_unless_told_otherwise_and_nothing_is_written_unasked(call, made):
    assert call("scene.yaml")[0] == 0
    assert made == ["basenet"]
    assert sorted(os.listdir()) == ["far.yaml", "scene.yaml"]


def test_objects_left_on_the_table_are_listed(call):
    code, out, err = call("far.yaml", "--out", "plan.json")
    assert code == 3
    assert "1 of 2 objects grasped" in out
    assert err == "basenet_jax.plan: 1 of 2 objects can't be grasped:\n  part_7: out_of_reach\n"
    with open("plan.json") as file:
        assert json.load(file)["steps"][1]["reason"] == "out_of_reach"


def test_markup_in_names_is_shown_as_it_is(call):
    with open("scene.yaml", "w") as file:
        file.write(TEXT.replace("mug_1", "'[b]m[/b]'"))
    code, out, _ = call("scene.yaml")
    assert code == 0
    assert "[b]m[/b]" in out


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_a_picture_is_drawn(call, suffix):
    assert call("scene.yaml", "--picture", f"plan.{suffix}")[0] == 0
    with open(f"plan.{suffix}", "rb") as file:
        assert file.read(5) == {"png": b"\x89PNG\r", "svg": b"<?xml"}[suffix]


def test_a_plan_is_exported_in_the_map(call):
    code, out, err = call("scene.yaml", "--export", "robot", "--table-pose", "1", "2", "90", "--map-frame", "hall")
    assert (code, err) == (0, "")
    assert "exported to robot: plan.yaml, execution.csv, bag; the robot takes" in out
    with open("robot/plan.yaml") as file:
        content = yaml.load(file, yaml.CSafeLoader)
    goal = content["commands"][0]["base_goal"]
    place = goal["pose"]["position"]
    # From (0.35, -0.9), a quarter of a turn to the left, then (1, 2).
    assert (place["x"], place["y"]) == pytest.approx((1.9, 2.35))
    assert goal["header"]["frame_id"] == "hall"
    code, _, err = call("scene.yaml", "--export", "robot")
    assert code == 2
    assert "--export: found robot, which isn't empty" in err


def test_an_export_leaves_out_what_fails_and_says_so(call):
    code, _, err = call("far.yaml", "--export", "robot", "--export-format", "csv")
    assert code == 3
    assert err.startswith("basenet_jax.plan: the export leaves out part_7 (out_of_reach)\n")
    assert os.listdir("robot") == ["execution.csv"]


def test_a_film_needs_a_backend(call, monkeypatch):
    def fail():
        raise offscreen.RenderError("MuJoCo can't draw here")

    monkeypatch.setattr(plan, "choose_backend", fail)
    assert call("scene.yaml", "--video", "a.mp4") == (2, "", "basenet_jax.plan: --video: MuJoCo can't draw here\n")


def test_a_film_shows_its_progress(call, monkeypatch):
    frames = [np.full((32, 48, 3), 10 * index, np.uint8) for index in range(5)]
    asked = {}

    def render(*given, **options):
        asked.update(options)
        return plots.Video(options.get("frames_per_s", 30.0), len(frames), iter(frames))

    monkeypatch.setattr(plan, "choose_backend", lambda: None)
    monkeypatch.setattr(plots, "render_video", render)
    code, _, err = call("scene.yaml", "--video", "a.mp4", "--video-speed", "4")
    assert (code, asked) == (0, {"speed": 4.0, "config": WorldConfig(), "given_times": False})
    assert "film: 5/5 (100 %)" in err
    with open("a.mp4", "rb") as file:
        assert file.read(8)[4:] == b"ftyp"
    assert call("scene.yaml", "--video", "a.gif")[0] == 0
    assert asked["width"] == 480


def test_explain_counts_base_poses(call, monkeypatch):
    from basenet_jax.planners import protocol

    # 64 poses before the table, so that little is computed.
    few = jnp.stack(jnp.meshgrid(jnp.linspace(-1, 1, 8), jnp.array([-1.0]), jnp.linspace(-3, 3, 8)), -1).reshape(-1, 3)
    monkeypatch.setattr(protocol, "grid_poses", lambda *_: few)
    code, out, _ = call("scene.yaml", "--explain")
    assert code == 0
    assert "from how many of 64 base poses" in out
    row = next(line for line in out.splitlines() if "part_7" in line and "0.35" not in line)
    counts = [int(cell) for cell in row.split()[1:]]
    assert sum(counts) == 64
    assert counts[0] > 0
    assert counts[1] > 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.yaml"], "none.yaml: can't be read: No such file or directory"),
        (["."], ".: can't be read: Is a directory"),
        (["scene.yaml", "--out", "nowhere/plan.json"], "--out: found nowhere/plan.json, whose folder isn't there"),
        (["scene.yaml", "--out", "."], "--out: found ., which is a folder, allowed is a file"),
        (["scene.yaml", "--out", "scene.yaml"], "--out: found scene.yaml, which is SCENE too, allowed is another file"),
        (["scene.yaml", "--out", "a.png", "--picture", "./a.png"], "--picture: found a.png, which is --out too"),
        (["scene.yaml", "--picture", "a.bmp"], "--picture: found a.bmp, allowed are names ending in .png, .pdf, .svg"),
        (["scene.yaml", "--export", "."], "--export: found ., which isn't empty, allowed is a new or empty folder"),
        (["scene.yaml", "--export", "no/where"], "--export: found no/where, whose folder isn't there, allowed is"),
        (["scene.yaml", "--table-pose", "0", "nan", "0"], "--table-pose: found (0.0, nan, 0.0), allowed are finite"),
        (["scene.yaml", "--video", "a.avi"], "--video: found a.avi, allowed are names ending in .mp4, .gif"),
        (["scene.yaml", "--video-speed", "0"], "--video-speed: found 0.0, allowed are 0.1 to 1000"),
        (["scene.yaml", "--video-speed", "1e-9"], "--video-speed: found 1e-09, allowed are 0.1 to 1000"),
        (["scene.yaml", "--video-speed", "nan"], "--video-speed: found nan, allowed are 0.1 to 1000"),
        (
            ["scene.yaml", "--planner", "basenet-sample", "--samples", "1000000000"],
            "SampleOptions.samples: found 1000000000, allowed are whole numbers, 1 to 16384",
        ),
    ],
    ids=range(15),
)
def test_bad_input_is_refused_before_planning(call, made, arguments, said):
    code, out, err = call(*arguments)
    assert (code, out, made) == (2, "", [])
    assert err.startswith(f"basenet_jax.plan: {said}")
    assert err.count("\n") == 1
    assert sorted(os.listdir()) == ["far.yaml", "scene.yaml"]


LONG, CIRCLES = "File name too long", "Too many levels of symbolic links"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a" * 256], LONG),
        (["circle"], CIRCLES),
        (["scene.yaml", "--out", "a" * 256], LONG),
        (["scene.yaml", "--out", "circle"], CIRCLES),
        (["scene.yaml", "--picture", "circle/a.png"], CIRCLES),
        (["scene.yaml", "--robot", "circle/robot.yaml"], CIRCLES),
        (["scene.yaml", "--robot", "a" * 256 + ".yaml"], LONG),
        (["scene.yaml", "--config", "a" * 256 + ".yaml"], LONG),
        (["scene.yaml", "--export", "a" * 256], LONG),
        (["scene.yaml", "--export", "circle"], "circle"),
        (["scene.yaml", "--drive-times", "circle"], CIRCLES),
    ],
)
def test_names_that_the_system_does_not_take_are_refused_before_planning(call, made, tmp_path, arguments, said):
    (tmp_path / "circle").symlink_to("circle")
    code, out, err = call(*arguments)
    assert (code, out, made) == (2, "", [])
    assert err.startswith("basenet_jax.plan: ")
    assert said in err
    assert err.count("\n") == 1
    assert sorted(os.listdir()) == ["circle", "far.yaml", "scene.yaml"]


def test_a_folder_without_the_right_to_write_is_found_before_planning(call, made, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # for the superuser no folder is like that
    code, _, err = call("scene.yaml", "--out", "plan.json")
    assert (code, made) == (2, [])
    assert err.startswith("basenet_jax.plan: --out: found plan.json, which can't be written, allowed is")


def test_a_disk_that_fails_leaves_no_half_of_a_plan(call, monkeypatch):
    def fail(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    code, out, err = call("scene.yaml", "--out", "plan.json")
    assert (code, out) == (2, "")
    assert err == "basenet_jax.plan: plan.json: can't be written: No space left on device\n"
    assert sorted(os.listdir()) == ["far.yaml", "scene.yaml"]


def test_what_a_planner_refuses_is_passed_on(call, monkeypatch):
    def refuse(scene, key):
        raise PlanningError("objects: found 2, dp plans at most 1; use basenet")

    monkeypatch.setattr(registry, "make_planner", lambda name, setup, options: refuse)
    code, out, err = call("scene.yaml", "--out", "plan.json")
    assert (code, out) == (2, "")
    assert err == "basenet_jax.plan: scene.yaml: objects: found 2, dp plans at most 1; use basenet\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--planner", "best"], "planner: found 'best', allowed are pbg, pbg-gc, mbp, mbp-gc, dp, "),
        (["--weights", "none"], "none: can't be read: No such file or directory"),
        (["--weights", "scene.yaml"], "scene.yaml: format: found 'format: basenet-sce', needs 'basenet-weights/1'"),
    ],
    ids=range(3),
)
def test_an_unknown_planner_and_wrong_weights_are_named(call, monkeypatch, arguments, said):
    monkeypatch.setattr(registry, "make_planner", MAKE_PLANNER)
    code, out, err = call("scene.yaml", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"basenet_jax.plan: {said}")


def test_an_interrupt_ends_quietly(call, monkeypatch):
    def interrupt(scene, key):
        raise KeyboardInterrupt

    monkeypatch.setattr(registry, "make_planner", lambda name, setup, options: interrupt)
    assert call("scene.yaml") == (130, "", "basenet_jax.plan: interrupted\n")


def test_help_teaches(call):
    code, out, _ = call("--help")
    assert code == 0
    assert all(word in out for word in ("SCENE", "--planner", "--explain", "seconds", "degrees", "can't be grasped"))


def test_a_terminal_that_knows_no_greek_gets_question_marks(call, monkeypatch):
    with open("scene.yaml", "w", encoding="utf-8") as file:
        file.write(TEXT.replace("mug_1", "μ_1"))
    stream = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(stream, encoding="ascii"))
    assert plan.main(["scene.yaml"]) == 0
    sys.stdout.flush()
    assert b"?_1" in stream.getvalue()


def test_help_imports_no_jax():
    code = "import sys\nfrom basenet_jax import plan, generate\nsys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
