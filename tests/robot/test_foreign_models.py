"""URDF and MJCF models: small ones written here with all that goes wrong, and ones of other people's packages."""

import importlib.util
import shutil
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import yaml

from basenet_jax.evaluation.robot_check import compare_with_mujoco
from basenet_jax.robot.reading import RobotFileError, read_source
from tests.robot.conftest import ASSETS

AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
MESH_OFF = '<collision><geometry><mesh filename="package://mine/meshes/box.stl"/></geometry></collision>'
TETRAHEDRON = ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.3))


def urdf(shape='<collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>', slide=False):
    """A chain of six links; joint 3 may slide."""
    links = "".join(f'<link name="l{i}">{shape}</link>' for i in range(7))
    joints = "".join(
        f'<joint name="j{i}" type="{"prismatic" if slide and i == 3 else "revolute"}"><parent link="l{i - 1}"/>'
        f'<child link="l{i}"/><origin xyz="0.05 0.02 0.2" rpy="0.1 0 0.3"/><axis xyz="{AXES[i - 1]}"/>'
        f'<limit lower="-1" upper="2" effort="1" velocity="1"/></joint>'
        for i in range(1, 7)
    )
    tool = (
        '<link name="tip"/><joint name="fixed" type="fixed"><parent link="l6"/><child link="tip"/>'
        '<origin xyz="0 0 0.1" rpy="0 3.1 0"/></joint>'
    )
    return f'<robot name="x">{links}{joints}{tool}<gazebo/></robot>'


def robot_file(folder: Path, **fields):
    content = yaml.safe_load((ASSETS / "ur5e_mobile.yaml").read_text())
    content.pop("closed_form")
    count = len(fields["joints"])
    rates = {"joint_speed": [1.0] * count, "joint_acceleration": [1.4] * count}
    poses = {"home_degrees": [0.0] * count, "stow_degrees": [1.0] * count}
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump({**content, **rates, **poses, "name": "foreign", **fields}))
    return path


def chain_file(folder, text, **fields):
    (folder / "arm.urdf").write_text(text)
    names = [f"j{i}" for i in range(1, 7)]
    frames = {"arm_base": "l0", "tool": "tip"}
    return robot_file(folder, model="arm.urdf", joints=names, frames=frames, **fields)


def write_stl(path: Path, scale=1.0):
    """Binary, the kind that MuJoCo reads."""
    corners = scale * np.array(TETRAHEDRON)
    path.parent.mkdir(exist_ok=True)
    triangles = np.zeros(4, dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    triangles["v"] = [[corners[i] for i in face] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    path.write_bytes(b"\0" * 80 + np.uint32(4).tobytes() + triangles.tobytes())


@pytest.mark.parametrize("slide", [False, True])
def test_a_urdf_moves_as_mujoco_says(tmp_path, slide):
    source = read_source(chain_file(tmp_path, urdf(slide=slide)))
    assert source.robot.prismatic == (False, False, slide, False, False, False)
    assert source.robot.capsule_link == (1, 2, 3, 4, 5, 6)
    assert compare_with_mujoco(source).is_small


def test_meshes_become_capsules_about_them(tmp_path):
    write_stl(tmp_path / "meshes" / "box.stl")
    robot = read_source(chain_file(tmp_path, urdf(MESH_OFF))).robot
    assert robot.capsule_link == (1, 2, 3, 4, 5, 6)
    corners, start, end = np.array(TETRAHEDRON), robot.capsule_start[0], robot.capsule_end[0]
    # In the joint's frame, which here is turned against the link's where the axis isn't z; joint 1's is.
    along = end - start
    t = np.clip((corners - start) @ along / (along @ along), 0.0, 1.0)
    distance = np.linalg.norm(corners - start - t[:, None] * along, axis=1)
    assert np.all(distance <= robot.capsule_radius[0] + 1e-6)
    assert robot.capsule_radius[0] < 0.1


def test_an_absent_mesh_is_named_unless_the_robot_file_has_capsules(tmp_path):
    path = chain_file(tmp_path, urdf(MESH_OFF))
    with pytest.raises(RobotFileError, match=r"mesh: found 'package://mine/meshes/box\.stl', which is no file in the"):
        read_source(path)
    own = [{"frame": "l4", "start": [0.0, 0.0, 0.0], "end": [0.0, 0.0, 0.2], "radius": 0.05}]
    robot = read_source(chain_file(tmp_path, urdf(MESH_OFF), capsules=own)).robot
    assert robot.capsule_link == (4,)


def test_meshes_out_of_the_folder_are_not_read(tmp_path):
    write_stl(tmp_path / "box.stl")
    folder = tmp_path / "inner"
    folder.mkdir()
    for place in ("../box.stl", str(tmp_path / "box.stl"), "file://" + str(tmp_path / "box.stl")):
        text = urdf(MESH_OFF.replace("package://mine/meshes/box.stl", place))
        with pytest.raises(RobotFileError, match=r"which (is no file in|leads out of) the robot file.s folder"):
            read_source(chain_file(folder, text))


def test_meshes_in_millimetres_are_noticed(tmp_path):
    write_stl(tmp_path / "meshes" / "box.stl", scale=1000.0)
    with pytest.raises(
        RobotFileError, match=r"with a radius of .* m, allowed are up to 0\.5 m \(are its meshes in mm\?\)"
    ):
        read_source(chain_file(tmp_path, urdf(MESH_OFF)))


def test_a_broken_mesh_is_refused(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "box.stl").write_bytes(b"\xff" * 200)
    with pytest.raises(RobotFileError, match=r"model: mesh: 'package://mine/meshes/box\.stl': found no mesh \("):
        read_source(chain_file(tmp_path, urdf(MESH_OFF)))


CYCLE = '<joint name="c" type="fixed"><parent link="tip"/><child link="l0"/></joint></robot>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</robot>", CYCLE, "found a cycle of links through"),
        ("</robot>", CYCLE.replace('child link="l0"', 'child link="l3"'), "found a second joint to link 'l3'"),
        ('<child link="l3"/>', "", "joint 'j3': found no parent or child, allowed is one of each"),
        ('<child link="l3"/>', '<child link="nobody"/>', "model: "),
        ('xyz="0.05 0.02 0.2"', 'xyz="50 20 200"', r"m long from joint 1 to the tool, allowed is 0\.2 to 4\.0 m"),
        ('lower="-1" upper="2"', 'lower="2" upper="-1"', "model: |joints"),
        ("<axis", '<axis xyz="0 0 0"/><nothing', "model: "),
    ],
)
def test_a_wrong_urdf_is_explained(tmp_path, old, new, message):
    with pytest.raises(RobotFileError, match=message) as caught:
        read_source(chain_file(tmp_path, urdf().replace(old, new)))
    assert "\n" not in str(caught.value)


def package_folder(package: str) -> Path:
    """Where a package keeps its models; skipped if it isn't installed."""
    if package == "example-robot-data":
        try:
            files = metadata.files(package) or []
        except metadata.PackageNotFoundError:
            pytest.skip("needs: make models")
        (model,) = (file for file in files if str(file).endswith("ur_description/urdf/ur5_robot.urdf"))
        return Path(str(model.locate())).parents[2]
    spec = importlib.util.find_spec(package)  # without importing it: that needs much more
    if spec is None or spec.origin is None:
        pytest.skip("needs: make models")
    return Path(spec.origin).parent


UR = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
READY = [0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0]
FOREIGN = {
    "ur5.urdf": ("example-robot-data", "ur_description", "urdf/ur5_robot.urdf", "base_link", "tool0", UR, None),
    "panda.urdf": (
        "example-robot-data",
        "panda_description",
        "urdf/panda.urdf",
        "panda_link0",
        "panda_link8",
        [f"panda_joint{i}" for i in range(1, 8)],
        READY,
    ),
    "panda.xml": (
        "robosuite",
        "models/assets/robots/panda",
        "robot.xml",
        "link0",
        "right_hand",
        [f"joint{i}" for i in range(1, 8)],
        READY,
    ),
    "ur5e.xml": ("robosuite", "models/assets/robots/ur5e", "robot.xml", "base", "right_hand", UR, None),
    "iiwa.xml": (
        "robosuite",
        "models/assets/robots/iiwa",
        "robot.xml",
        "base",
        "right_hand",
        [f"joint_{i}" for i in range(1, 8)],
        None,
    ),
    "sawyer.xml": (
        "robosuite",
        "models/assets/robots/sawyer",
        "robot.xml",
        "base",
        "right_hand",
        [f"right_j{i}" for i in range(7)],
        None,
    ),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_models_that_nobody_here_wrote(tmp_path, name):
    package, folder, model, arm_base, tool, joints, home = FOREIGN[name]
    shutil.copytree(package_folder(package) / folder, tmp_path / "copy")
    poses = {} if home is None else {"home_degrees": list(home), "stow_degrees": list(home)}
    frames = {"arm_base": arm_base, "tool": tool}
    source = read_source(robot_file(tmp_path / "copy", model=model, frames=frames, joints=joints, **poses))
    assert compare_with_mujoco(source).is_small
    moving = set(source.robot.capsule_link)
    assert moving >= set(range(2, len(joints)))  # every long link has a shape
    assert np.all((source.robot.capsule_radius > 0) & (source.robot.capsule_radius < 0.15))
