"""Scene files are grouped by their number of objects, and what can't be evaluated together is refused."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.evaluation.scene_sets import load_sets
from basenet_jax.world.scene import NamedScene
from basenet_jax.world.scene_file import save_scene
from tests import judged


@pytest.fixture
def folder(tmp_path):
    """Two files of two objects and one of one; and what is no scene."""
    for index, name in enumerate(("b.yaml", "a.json")):
        arrays = jax.tree.map(lambda x, index=index: x[index], judged.scenes())
        save_scene(tmp_path / name, NamedScene(arrays, ("left", "right")))
    one = dataclasses.replace(judged.first(judged.scenes()), mask=np.array([True, False]))
    save_scene(tmp_path / "c.yml", NamedScene(one, ("left",)))
    (tmp_path / "notes.txt").write_text("no scene")
    return tmp_path


def test_files_are_grouped_by_number_of_objects(folder):
    robot, (one, two) = load_sets(folder)
    assert robot == "ur5e_mobile"
    assert (one.objects, one.labels) == (1, ("c.yml",))
    assert (two.objects, two.labels) == (2, ("a.json", "b.yaml"))
    np.testing.assert_allclose(two.scenes.object_pose, judged.scenes().object_pose[np.array([1, 0])], atol=1e-6)
    assert bool(two.scenes.mask.all())


def test_a_folder_without_scenes_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"found no scene files, which end in \.yaml, \.yml, \.json"):
        load_sets(tmp_path)
    with pytest.raises(ValueError, match="found no folder"):
        load_sets(tmp_path / "none")


def test_a_bad_file_is_refused_by_name(folder):
    (folder / "d.yaml").write_text("format: basenet-scene/1\nobjects: []\n")
    with pytest.raises(ValueError, match=r"d\.yaml: objects"):
        load_sets(folder)


def test_scenes_for_two_robots_are_refused_unless_one_is_asked_for(folder):
    path = folder / "b.yaml"
    path.write_text(path.read_text().replace("ur5e_mobile", "ur10e_mobile"))
    with pytest.raises(ValueError, match="found scenes for ur10e_mobile, ur5e_mobile; an evaluation has one robot"):
        load_sets(folder)
    assert load_sets(folder, "ur3e_mobile")[0] == "ur3e_mobile"
