"""Files from a page go through the commands' loaders, under the name that their owner knows."""

import dataclasses
import json

import jax
import numpy as np
import pytest
from PIL import Image

from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.task.plan_file import load_plan
from basenet_jax.viewer import furnishing, uploads
from basenet_jax.viewer.editing import pad
from basenet_jax.world.scene_file import load_scene
from tests.scene_texts import CONTENT, TEXT
from tests.viewer.conftest import EXAMPLE


def test_a_scene_comes_back_as_it_went(scene):
    read = uploads.read_scene("any.yaml", uploads.scene_file(scene))
    assert read.names == scene.names
    for found, expected in zip(jax.tree.leaves(read.arrays), jax.tree.leaves(scene.arrays), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_room_comes_back_with_the_map_that_is_shown(tmp_path):
    """A page sends no map, and may name no other file of this machine."""
    Image.fromarray(np.full((200, 200), 254, np.uint8)).save(tmp_path / "hall.pgm")
    (tmp_path / "hall.yaml").write_text(
        "{image: hall.pgm, resolution: 0.05, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.25}"
    )
    (tmp_path / "room.yaml").write_text(EXAMPLE.read_text().replace("floor:", "map: hall.yaml\nfloor:"))
    shown = pad(load_scene(tmp_path / "room.yaml"))
    assert shown.map is not None
    content = uploads.scene_file(furnishing.move_piece(shown, "bench", np.array([2.2, 4.4, 0.3])))
    read = uploads.read_scene("any.yaml", content, before=shown)
    assert read.map is shown.map
    assert furnishing.pose_of(furnishing.pieces(read.furniture)["bench"].piece) == pytest.approx([2.2, 4.4, 0.3])
    assert read.box_names == shown.box_names
    with pytest.raises(ValueError, match=r"any\.yaml: map: found 'hall\.yaml'"):
        uploads.read_scene("any.yaml", content)


def test_the_end_of_the_name_tells_json_from_yaml():
    assert uploads.read_scene("Scene.JSON", json.dumps(CONTENT).encode()).names == ("mug_1", "part_7")
    assert uploads.read_scene("scene.yml", TEXT.encode()).names == ("mug_1", "part_7")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "my scene.yaml: content: found an empty file"),
        (b"\xff\xfe", "my scene.yaml: content: found the byte 0xff"),
        (TEXT.replace("mug, pose", "cup, pose").encode(), r"my scene.yaml: objects\[0\].class: found 'cup'"),
        (b"x" * 70_000, "my scene.yaml: content: found more than 65536 bytes"),
    ],
)
def test_a_bad_scene_is_refused_in_the_loaders_words(content, message):
    with pytest.raises(ValueError, match=message) as caught:
        uploads.read_scene("my scene.yaml", content)
    assert "tmp" not in str(caught.value)


@pytest.mark.parametrize("model", ["/etc/passwd", "robot.yaml", "../../robot.yaml"])
def test_a_scene_names_packaged_robots_and_no_file(model):
    text = TEXT.replace("ur5e_mobile", model)
    with pytest.raises(ValueError, match=r"robot\.model: found .*allowed are .*; a robot of your own .*--robot"):
        uploads.read_scene("scene.yaml", text.encode())


def test_the_robot_of_the_command_line_goes_before_the_files():
    text = TEXT.replace("ur5e_mobile", "somebody_elses")
    assert uploads.read_scene("scene.yaml", text.encode(), robot="ur10e_mobile").robot == "ur10e_mobile"


def test_a_plan_comes_back_as_it_went(planned, scene):
    read = uploads.read_plan("plan.json", uploads.plan_file(planned), scene)
    np.testing.assert_array_equal(read.object_index[:2], planned.plan.object_index[:2])
    np.testing.assert_array_equal(read.base_pose[:2], planned.plan.base_pose[:2])


def test_a_plan_of_another_world_is_refused(planned, scene):
    world = WorldConfig(pick=PickConfig(close_s=0.5))
    with pytest.raises(ValueError, match=r"mine\.json: world\.pick\.close_s: found 1\.0, allowed is 0\.5"):
        uploads.read_plan("mine.json", uploads.plan_file(planned), scene, world)
    changed = uploads.plan_file(dataclasses.replace(planned, world=world))
    assert uploads.read_plan("mine.json", changed, scene, world).object_index.tolist()[:2] == [0, 1]


def test_a_plan_of_another_scene_is_refused(planned):
    other = uploads.read_scene("scene.yaml", TEXT.encode())
    with pytest.raises(ValueError, match=r"mine\.json: steps\[1\]\.object: found 'mug_2'"):
        uploads.read_plan("mine.json", uploads.plan_file(planned), other)


def test_a_saved_plan_is_one_that_the_commands_read(planned, scene, tmp_path):
    (tmp_path / "plan.json").write_bytes(uploads.plan_file(planned))
    assert load_plan(tmp_path / "plan.json", scene).object_index.tolist()[:2] == [0, 1]
