"""Configuration files: partial, nested like the dataclasses, refused by file and field."""

import json

import msgspec
import pytest

from basenet_jax.config import NavigationConfig, PickConfig, WorldConfig
from basenet_jax.documents.config_file import ConfigFileError, differences, load_config, overlay
from basenet_jax.learning.config import SacConfig, TrainConfig, make_preset


@pytest.fixture
def write(tmp_path):
    """Writes a file and gives its path."""

    def write(text, name="c.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_what_a_file_leaves_out_stays(write):
    base = make_preset("quick", objects=3, seed=5)
    path = write("seed: 7\nworld: {pick: {close_s: 2, descent_heights_m: [0.05]}}\nsac: {hidden: [8, 16]}\n")
    changed = load_config(path, base)
    assert changed.world == WorldConfig(pick=PickConfig(close_s=2.0, descent_heights_m=(0.05,)))
    assert (changed.seed, changed.sac.hidden, changed.sac.intervals) == (7, (8, 16), base.sac.intervals)
    assert (changed.reinforce, changed.stops) == (base.reinforce, base.stops)


@pytest.mark.parametrize("preset", ["quick", "default", "paper"])
def test_what_a_training_writes_reads_back_as_the_same(write, preset):
    config = make_preset(preset, objects=7, seed=3, robot="mine", robot_digest="ab")
    text = msgspec.json.format(msgspec.json.encode(config, order="sorted"), indent=2).decode()
    for name in ("config.json", "config.yaml"):
        assert load_config(write(text, name), TrainConfig()) == config


def test_settings_that_go_together_may_be_changed_together(write):
    path = write("pregrasp_height_m: 0.05\ndescent_heights_m: [0.03]\n")
    assert load_config(path, PickConfig()).pregrasp_height_m == 0.05


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "content: found an empty file, allowed is YAML or JSON"),
        ("a", "content: found 'a', allowed is a mapping of settings"),
        ("[1]", "content: found [1], allowed is a mapping of settings"),
        ("{", "line 1: no YAML"),
        (
            "sacs: {}",
            "sacs: found an unknown key, allowed are preset, seed, robot, robot_digest, world, sac",
        ),
        ("world: {pick: {close: 1}}", "world.pick.close: found an unknown key, allowed are pregrasp_height_m, descent"),
        ("world: 1", "world: found 1, allowed is a mapping of its settings"),
        ("world: null", "world: found null, allowed is a mapping of its settings"),
        ("world: {pick: {close_s: fast}}", "world.pick.close_s: found 'fast', allowed are numbers, 0 to 1000000000"),
        ("world: {pick: {close_s: -1}}", "world.pick.close_s: found -1, allowed are numbers, 0 to 1000000000"),
        ("world: {pick: {close_s: .nan}}", "world.pick.close_s: found nan, allowed are finite numbers"),
        ("world: {pick: {descent_heights_m: 0.05}}", "world.pick.descent_heights_m: found 0.05, allowed is a list"),
        ("world: {pick: {descent_heights_m: [x]}}", "world.pick.descent_heights_m[0]: found 'x', allowed are numbers"),
        ("world: {navigation: {straight: 1}}", "world.navigation.straight: found 1, allowed are true and false"),
        ("sac: {batch_size: 1.5}", "sac.batch_size: found 1.5, allowed are whole numbers, 1 to"),
        ("preset: fast", "preset: found 'fast', allowed are quick, default, paper"),
        (
            "world: {pick: {pregrasp_height_m: 0.01}}",
            "world.pick.descent_heights_m: found (0.075, 0.05, 0.025)",
        ),
        ("world: {table: {width_m: 0.1}}", "world.scene.edge_margin_m: found 0.08, allowed are 0 to 0.05, half"),
        ("seed: 1\nseed: 2", "seed: found the key twice, allowed is once"),
        ("x: " + "[" * 30 + "]" * 30, "line 1: found more than 16 levels of nesting"),
        ("# " + "x" * 70_000, "content: found more than 65536 bytes, allowed are up to 65536"),
    ],
    ids=range(21),
)
def test_wrong_files_are_refused_by_file_and_field(write, text, message):
    path = write(text)
    with pytest.raises(ConfigFileError) as refused:
        load_config(path, TrainConfig())
    assert str(refused.value).startswith(f"{path}: {message}")
    assert "\n" not in str(refused.value)


def test_what_is_no_file_is_refused(tmp_path):
    for path, message in ((tmp_path, "Is a directory"), (tmp_path / "none.yaml", "No such file")):
        with pytest.raises(ConfigFileError, match=f"{path}: can't be read: {message}"):
            load_config(path, SacConfig())


def test_json_is_read_as_such(write):
    path = write(json.dumps({"straight": True}), "c.json")
    assert load_config(path, NavigationConfig()) == NavigationConfig(straight=True)


def test_differences_are_what_makes_one_of_the_other(tmp_path):
    changed = WorldConfig(pick=PickConfig(close_s=0.5, descent_heights_m=(0.06, 0.03)))
    found = differences(changed, WorldConfig())
    assert found == {"pick": {"close_s": 0.5, "descent_heights_m": [0.06, 0.03]}}
    assert overlay(WorldConfig(), found, "file") == changed
    assert differences(WorldConfig(), WorldConfig()) == {}
