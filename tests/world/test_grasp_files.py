"""Grasps in files: YAML and NumPy's matrices, tool frames, and what is wrong with them."""

import json

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from basenet_jax.world.scene_file import SceneFileError, load_scene, save_scene
from tests.room_texts import content


@pytest.fixture
def folder(tmp_path):
    return tmp_path


def load(folder, grasps, **more):
    """The room whose third object has these grasps."""
    room = content()
    room["objects"][2] |= {"grasps": grasps, **more}
    (folder / "room.json").write_text(json.dumps(room))
    return load_scene(folder / "room.json")


def kept(scene):
    """Which of those written the third object's are."""
    assert scene.kept_grasps is not None
    return scene.kept_grasps[2]


def said(folder, grasps, **more):
    with pytest.raises(SceneFileError) as caught:
        load(folder, grasps, **more)
    return str(caught.value).removeprefix(f"{folder / 'room.json'}: ")


def matrices(count, seed=0):
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-0.3, 0.3, (count, 3))
    return poses


def as_matrices(pose):
    poses = np.tile(np.eye(4), (len(pose), 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", pose[:, :2:-1]).as_matrix()
    poses[:, :3, 3] = pose[:, :3]
    return poses


def read(scene):
    """The third object's grasps that are there, as matrices."""
    grasps = jax.device_get(scene.arrays.object_grasps)[2]
    return as_matrices(grasps.pose[grasps.there].astype(float))


def test_matrices_are_read(folder):
    np.save(folder / "part.npy", matrices(7))
    scene = load(folder, "part.npy")
    np.testing.assert_allclose(read(scene), matrices(7), atol=1e-6)
    assert kept(scene) == tuple(range(7))
    assert scene.arrays.object_grasps.pose.shape == (3, 16, 6)


def test_of_many_sixteen_are_kept_and_known_by_their_place_in_the_file(folder):
    np.save(folder / "part.npy", matrices(200))
    scene = load(folder, "part.npy")
    assert len(set(kept(scene))) == 16
    np.testing.assert_allclose(read(scene), matrices(200)[list(kept(scene))], atol=1e-6)


def test_grasps_of_another_frame_than_tool0(folder):
    """The frame is 0.1034 m along tool0's z and turned by 45 degrees, as a Franka hand's tool centre is."""
    frame = {"position": [0.0, 0.0, 0.1034], "rpy_degrees": [0, 0, -45]}
    np.save(folder / "part.npy", matrices(3))
    in_tool0 = as_matrices(np.array([[0.0, 0.0, 0.1034, 0.0, 0.0, -np.pi / 4]]))[0]
    expected = matrices(3) @ np.linalg.inv(in_tool0)
    np.testing.assert_allclose(read(load(folder, "part.npy", tool_frame=frame)), expected, atol=1e-6)
    grasps = [{"position": p.tolist(), "rpy_degrees": r.tolist()} for p, r in poses(matrices(3))]
    np.testing.assert_allclose(read(load(folder, grasps, tool_frame=frame)), expected, atol=1e-6)
    (folder / "own.yaml").write_text(json.dumps({"format": "basenet-grasps/1", "tool_frame": frame, "grasps": grasps}))
    np.testing.assert_allclose(read(load(folder, "own.yaml")), expected, atol=1e-6)


def poses(matrices):
    angles = Rotation.from_matrix(matrices[:, :3, :3]).as_euler("ZYX", degrees=True)[:, ::-1]
    return list(zip(matrices[:, :3, 3], angles, strict=True))


def test_the_best_score_comes_first(folder):
    grasps = [
        {"position": p.tolist(), "rpy_degrees": r.tolist(), "score": float(index == 17)}
        for index, (p, r) in enumerate(poses(matrices(20)))
    ]
    assert kept(load(folder, grasps))[0] == 17


def test_what_was_kept_is_what_is_saved(folder):
    np.save(folder / "part.npy", matrices(40))
    scene = load(folder, "part.npy")
    save_scene(folder / "saved.yaml", scene)
    jax.tree.map(
        np.testing.assert_array_equal,
        load_scene(folder / "saved.yaml").arrays.object_grasps,
        scene.arrays.object_grasps,
    )


def test_what_is_wrong_with_matrices_is_said(folder):
    whole = "objects[2].grasps: part.npy: "
    for array, found in [
        (np.zeros((0, 4, 4)), "content: found an array of shape (0, 4, 4), allowed is n x 4 x 4, n from 1 to 200"),
        (np.zeros((201, 4, 4)), "content: found an array of shape (201, 4, 4), allowed is n x 4 x 4"),
        (np.eye(4), "content: found an array of shape (4, 4), allowed is n x 4 x 4"),
        (np.full((1, 4, 4), np.nan), "content: found numbers of type float64, or not finite"),
        (np.ones((2, 4, 4), int), "content: found numbers of type int64"),
        (np.stack([np.eye(4), np.diag([1.0, 1, -1, 1])]), "[1]: found no rigid transform, allowed are a rotation"),
        (2 * np.eye(4)[None], "[0]: found no rigid transform"),
        (np.eye(4)[None] + far(), "[0]: found the position [3.0, 0.0, 0.0]"),
    ]:
        np.save(folder / "part.npy", array)
        assert said(folder, "part.npy").startswith(whole + found)
    (folder / "part.npy").write_bytes(b"no array")
    assert said(folder, "part.npy").startswith(whole + "content: found no array that can be read")
    np.save(folder / "part.npy", np.array([{}], object), allow_pickle=True)
    assert said(folder, "part.npy").startswith(whole + "content: found no array that can be read")


def far():
    shift = np.zeros((1, 4, 4))
    shift[0, 0, 3] = 3.0
    return shift


def test_what_is_wrong_with_files_is_said(folder):
    assert said(folder, "part.yaml").startswith("objects[2].grasps: found 'part.yaml', allowed are files in the scene")
    assert said(folder, "/etc/hostname").startswith("objects[2].grasps: found '/etc/hostname', allowed are files in")
    (folder / "part.yaml").write_text("format: basenet-grasps/1\ngrasps: []\n")
    assert said(folder, "part.yaml").startswith("objects[2].grasps: part.yaml: grasps: found [], allowed is a list of")
    (folder / "part.yaml").write_text("format: basenet-grasps/2\ngrasps: []\n")
    assert said(folder, "part.yaml").startswith("objects[2].grasps: part.yaml: format: found 'basenet-grasps/2'")


def test_grasps_of_other_frames_are_known_by_where_they_are(folder):
    """Those of a room's frame are far away, those of a frame whose z points back at the wrist come from below."""
    above = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (3, 1, 1))  # the tips at the object's top, z down
    above[:, :3, 3] = [0.0, 0.0, 0.05]
    back = above @ np.diag([1.0, -1.0, -1.0, 1.0])
    tips = {"position": [0.0, 0.0, 0.2], "rpy_degrees": [0, 0, 0]}
    turned = tips | {"rpy_degrees": [180, 0, 0]}
    np.save(folder / "part.npy", above)
    np.testing.assert_allclose(read(load(folder, "part.npy", tool_frame=tips))[:, 2, 3], 0.25, atol=1e-6)
    np.save(folder / "part.npy", back)
    found = said(folder, "part.npy", tool_frame=tips)
    assert found.startswith(
        "objects[2].grasps: part.npy: found grasps from below the object and none from above, allowed are tool frames"
    )
    assert found.endswith("turn tool_frame by rpy_degrees: [180, 0, 0])")
    np.testing.assert_allclose(read(load(folder, "part.npy", tool_frame=turned))[:, 2, 3], 0.25, atol=1e-6)
    one = back.copy()
    one[1] = above[1]
    np.save(folder / "part.npy", one)
    load(folder, "part.npy", tool_frame=tips)  # one from above will do
    above[:, 0, 3] = 0.9
    np.save(folder / "part.npy", above)
    found = said(folder, "part.npy", tool_frame=tips)
    assert found.startswith("objects[2].grasps: part.npy: found no grasp nearer to the object than 0.88 m, allowed are")
    load(folder, [{"position": [0.9, 0.0, 0.0], "rpy_degrees": [180, 0, 0]}])  # what was written by hand is meant


def test_a_tool_frame_is_for_grasps_of_ones_own(folder):
    room = content()
    room["objects"][0]["tool_frame"] = {"position": [0, 0, 0.1], "rpy_degrees": [0, 0, 0]}
    (folder / "room.json").write_text(json.dumps(room))
    with pytest.raises(SceneFileError, match=r"objects\[0\].tool_frame: found it beside class"):
        load_scene(folder / "room.json")
