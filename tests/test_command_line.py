"""Settings on the command line, in files and by default: which comes first, and what is refused."""

import dataclasses
import json

import pytest

from basenet_jax import ablate, api, evaluate, generate, plan, train, view
from basenet_jax.command_line import PlannerArguments, base_config, peek, world_of_file
from basenet_jax.config import AlignedConfig, GridConfig, NavigationConfig, PickConfig, WorldConfig
from basenet_jax.learning.config import make_preset
from basenet_jax.planners import registry
from basenet_jax.planners.options import RefinedOptions
from basenet_jax.planners.registry import PLANNERS
from basenet_jax.world.scene_file import load_scene
from tests.scene_texts import TEXT, park_once

COMMANDS = {"plan": (plan, ["s.yaml"]), "evaluate": (evaluate, ["--out", "o"]), "generate": (generate, ["--out", "o"])}
COMMANDS |= {"view": (view, []), "train": (train, ["--run-dir", "o"]), "ablate": (ablate, ["--out", "o"])}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(TEXT)
    return tmp_path


@pytest.fixture
def made(monkeypatch):
    """What planners were made with; they cost nothing."""
    seen = []

    def make(name, setup, options):
        seen.append((name, setup, options))
        return park_once

    monkeypatch.setattr(registry, "make_planner", make)
    api._planner.cache_clear()
    yield seen
    api._planner.cache_clear()


def call(capsys, command, *arguments):
    """Exit code, stdout and stderr."""
    try:
        code = command.main([*arguments])
    except SystemExit as end:  # tyro ends so on --help and wrong options
        code = end.code
    return code, *capsys.readouterr()


def test_options_are_found_before_they_are_parsed():
    arguments = ["a", "--config", "x", "--run_dir=y=z", "--objects"]
    assert [peek(arguments, name) for name in ("--config", "--run-dir", "--objects", "--seed")] == [
        "x", "y=z", None, None,
    ]  # fmt: skip
    assert peek(["--seed", "1", "--seed=2"], "--seed") == "2"


def test_a_plan_is_made_and_judged_in_the_world_that_is_asked_for(capsys, folder, made):
    """Picks with a gripper that closes at once take a second less each; straight drives take less time."""
    given = (["--out", "usual.json"], ["--world.pick.close-s", "0", "--world.navigation.straight", "--out", "p.json"])
    for arguments in given:
        code, _, err = call(capsys, plan, "s.yaml", "--planner", "dp", *arguments)
        assert code == 0, err
    usual, other = (json.loads((folder / name).read_text())["steps"] for name in ("usual.json", "p.json"))
    for one, two in zip(usual, other, strict=True):
        assert one["pick_time_s"] - two["pick_time_s"] == pytest.approx(1.0, abs=1e-4)
    assert sum(step["navigation_time_s"] for step in other) < sum(step["navigation_time_s"] for step in usual) - 0.1
    expected = WorldConfig(pick=PickConfig(close_s=0.0), navigation=NavigationConfig(straight=True))
    assert made[-1][1].world == expected


def test_the_command_line_comes_before_the_file_and_that_before_the_default(capsys, folder, made):
    (folder / "c.yaml").write_text("seed: 3\nworld: {pick: {close_s: 0.5, open_s: 0.25}}\n")
    assert call(capsys, plan, "s.yaml", "--config", "c.yaml", "--world.pick.open-s", "2", "--planner", "dp")[0] == 0
    assert made[-1][1].world == WorldConfig(pick=PickConfig(close_s=0.5, open_s=2.0))
    code, out, _ = call(capsys, plan, "--config=c.yaml", "--help")
    assert code == 0
    assert "(default: 0.25)" in out


def test_planners_get_their_own_options(capsys, folder, made):
    arguments = ["--planner", "refined", "--budget", "0.5", "--aligned.step-m", "0.2", "--grid.turns", "4"]
    assert call(capsys, plan, "s.yaml", *arguments)[0] == 0
    name, setup, options = made[-1]
    assert (name, setup.grid) == ("refined", GridConfig(turns=4))
    assert options == RefinedOptions(budget_s=0.5, aligned=AlignedConfig(step_m=0.2))


def test_random_scenes_stand_on_the_table_that_is_asked_for(capsys, folder):
    arguments = ["--out", "o", "--count", "1", "--objects", "3", "--world.table.length-m", "1.5"]
    assert call(capsys, generate, *arguments, "--world.scene.start-distance-m", "4", "4.5")[0] == 0
    scene = load_scene(folder / "o" / "scene-0000.yaml").arrays
    assert float(2 * scene.room.table_half_size[0]) == 1.5
    assert 4.0 <= float((scene.robot_start[:2] ** 2).sum() ** 0.5) <= 4.5


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "c.yaml: can't be read: No such file or directory"),
        ("", "c.yaml: content: found an empty file"),
        ("worlds: {}", "c.yaml: worlds: found an unknown key, allowed are "),
        ("world: {pick: {close_s: soon}}", "c.yaml: world.pick.close_s: found 'soon', allowed are numbers"),
    ],
)
def test_a_wrong_file_is_refused_before_any_work(capsys, folder, name, content, message):
    command, arguments = COMMANDS[name]
    if content is not None:
        (folder / "c.yaml").write_text(content)
    code, out, err = call(capsys, command, *arguments, "--config", "c.yaml")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"basenet_jax.{name}: {message}")
    assert not (folder / "o").exists()


@pytest.mark.parametrize("name", ["plan", "evaluate", "view", "train", "ablate"])
@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--world.pick.close-s", "nan", "PickConfig.close_s: found nan"),
        ("--world.pick.close-s", "1e300", "PickConfig.close_s: found 1e+300"),
        ("--world.pick.close-s", "soon", "--world.pick.close-s"),
        ("--world.pick.closes", "1", "--world.pick.closes"),
    ],
)
def test_a_wrong_setting_is_refused_before_any_work(capsys, folder, name, option, value, message):
    command, arguments = COMMANDS[name]
    code, out, err = call(capsys, command, *arguments, option, value)
    assert (code, out) == (2, "")
    assert message in err
    assert not (folder / "o").exists()


def test_an_option_of_another_planner_is_refused(capsys, folder):
    code, _, err = call(capsys, plan, "s.yaml", "--planner", "dp", "--samples", "64")
    assert (code, err) == (2, "basenet_jax.plan: options of the planner dp: found samples, allowed is none\n")
    code, _, err = call(capsys, plan, "s.yaml", "--planner", "refined", "--budget", "-1")
    assert code == 2
    assert "budget_s: found -1.0, allowed are numbers, 0 to" in err


@pytest.mark.parametrize("name", ["plan", "view"])
def test_help_names_every_planner_and_every_option(capsys, name):
    code, out, _ = call(capsys, COMMANDS[name][0], "--help")
    text = " ".join(out.replace("│", " ").split())
    assert code == 0
    assert ", ".join([*PLANNERS][:-1]) + " or " + [*PLANNERS][-1] in text.replace("basenet or", "basenet or")
    options = {option for kind in PLANNERS.values() for option in kind.option_names} - {"devices"}
    for option in options:
        assert f"--{option.removesuffix('_s').replace('_', '-')}" in text, option


def test_every_option_of_a_planner_can_be_given():
    """`devices` alone is the commands' own."""
    values = {"weights": "w", "budget": 1.0, "samples": 1, "seconds_per_object": 1.0}
    sections = {"aligned": AlignedConfig(step_m=0.3), "refinement": RefinedOptions().refinement}
    sections["refinement"] = dataclasses.replace(sections["refinement"], rounds=2)
    given = PlannerArguments(**values, **sections).given_options()
    assert set(given) | {"devices"} == {option for kind in PLANNERS.values() for option in kind.option_names}
    assert PlannerArguments().given_options() == {}


def test_a_training_is_a_preset_changed_by_a_file(folder):
    def preset(name, *, objects, seed):
        return make_preset(name, objects=objects, seed=seed)

    (folder / "c.yaml").write_text("preset: quick\nsac: {intervals: 2}\nreinforce: {objects: 4}\n")
    config = base_config([], preset, "c.yaml")
    quick = make_preset("quick", objects=10, seed=0)
    assert (config.preset, config.sac) == ("quick", dataclasses.replace(quick.sac, intervals=2))
    assert (config.reinforce.objects, config.stops.objects) == (4, 10)
    config = base_config(["--preset", "paper", "--objects", "6"], preset, "c.yaml")
    assert config.sac == dataclasses.replace(make_preset("paper", objects=6, seed=0).sac, intervals=2)
    assert (config.reinforce.objects, config.stops.objects) == (6, 6)
    assert base_config(["--objects", "none", "--preset", "fast"], preset, None) == make_preset(
        "default", objects=10, seed=0
    )


def test_a_world_may_come_from_a_trainings_file(folder):
    (folder / "config.json").write_text('{"seed": 1, "world": {"table": {"length_m": 1.2}}}')
    assert world_of_file(["--config", "config.json"]).table.length_m == 1.2
    assert world_of_file([]) == WorldConfig()
