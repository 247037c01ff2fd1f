"""Meshes: the right file or none, of the kinds that robots' makers use, and only those that count."""

import numpy as np
import pytest
import trimesh

from basenet_jax.robot.reading import RobotFileError, read_robot, read_source
from tests.robot import mini

BOX = (0.1, 0.12, 0.42)


def mesh_off(file, scale=""):
    return f'<collision><origin xyz="0 0 0.21"/><geometry><mesh filename="{file}"{scale}/></geometry></collision>'


def write_mesh(path, size=BOX, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"" if size is None else _bytes(trimesh.creation.box(size), path.suffix[1:].lower(), **options))


def _bytes(mesh, kind, **options):
    data = mesh.export(file_type="stl_ascii" if options.get("text") else kind)
    return data.encode() if isinstance(data, str) else data


def refused(path, *messages):
    with pytest.raises(RobotFileError) as caught:
        read_robot(path)
    for message in messages:
        assert message in str(caught.value)


def upper_arm(robot):
    """Ends and radius of the capsule about link 2, the mesh."""
    index = robot.capsule_link.index(2)
    ends = np.array([robot.capsule_start[index], robot.capsule_end[index]])
    return ends[np.argsort(ends[:, 2])], robot.capsule_radius[index]


def test_every_kind_of_mesh_is_the_same_shape(tmp_path):
    kinds = {"stl": {}, "STL": {}, "obj": {}, "dae": {}, "glb": {}, "ply": {}, "text.stl": {"text": True}}
    found = {}
    for kind, options in kinds.items():
        folder = tmp_path / kind
        write_mesh(folder / "meshes" / f"l2.{kind}", **options)
        found[kind] = upper_arm(
            read_source(mini.write(folder, mini.urdf(l2=mesh_off(f"package://d/meshes/l2.{kind}")))).robot
        )
    for kind, (ends, radius) in found.items():
        np.testing.assert_allclose(ends, found["stl"][0], atol=1e-5, err_msg=kind)
        assert radius == pytest.approx(found["stl"][1], abs=1e-5), kind


def test_a_collada_file_says_its_unit(tmp_path):
    write_mesh(tmp_path / "l2.dae", size=np.array(BOX) * 1000)
    path = mini.write(tmp_path, mini.urdf(l2=mesh_off("l2.dae")))
    refused(path, "are its meshes in mm?")
    dae = tmp_path / "l2.dae"
    text = dae.read_text()
    assert "<created>" in text
    dae.write_text(text.replace("<asset>", '<asset><unit name="millimeter" meter="0.001"/>', 1))
    assert upper_arm(read_source(path).robot)[1] == pytest.approx(np.hypot(0.05, 0.06), abs=1e-3)


def test_paths_of_windows_and_with_spaces(tmp_path):
    write_mesh(tmp_path / "my meshes" / "l2.stl")
    for file in ("my meshes\\l2.stl", "package://some desc/my meshes/l2.stl", "./my meshes/l2.stl"):
        assert read_source(mini.write(tmp_path, mini.urdf(l2=mesh_off(file)))).robot.capsule_link.count(2) == 1


CAMERA = (
    '<link name="mast"/><joint name="m" type="fixed"><parent link="mast"/><child link="base_link"/></joint>'
    '<link name="camera">{}</link><joint name="c" type="fixed"><parent link="mast"/><child link="camera"/></joint>'
)


@pytest.mark.parametrize("file", ["camera.dae", "camera.step", "a/" * 2000 + "x.stl", ""])
def test_a_mesh_that_does_not_count_need_not_be_there(tmp_path, file):
    """Of a camera on the mast, and of the arm's base, which is only drawn."""
    more = CAMERA.format(mesh_off(f"package://cameras/{file}"))
    robot = read_robot(mini.write(tmp_path, mini.urdf(more, base_link=mesh_off(f"package://arms/{file}"))))
    assert robot.capsule_link == read_robot(mini.write(tmp_path)).capsule_link


MISSING = {
    "absent": (
        "package://arms/l2.dae",
        "model: mesh: found 'package://arms/l2.dae', which is no file in the robot file's",
    ),
    "way out": ("package://arms/l2.dae", "(or name its package's folder: --package NAME=DIR)"),
    "long": ("package://" + "long_" * 30 + "/l2.dae", "long_long_/l2.dae', which is no file"),
    "kind": ("l2.step", "found 'l2.step', allowed are .stl, .obj, .dae, .glb, .ply, .msh"),
    "slashes": ("a/" * 2000 + "l2.stl", "a path of 2000 folders, allowed are up to 32"),
    "pointer": (
        "pointer.stl",
        "found a git-lfs pointer in place of 'pointer.stl', allowed is the mesh: run git lfs pull",
    ),
    "broken": (
        "broken.stl",
        "model: mesh: 'broken.stl': found no mesh (",
    ),
    "broken glb": ("broken.glb", "model: mesh: 'broken.glb': found no mesh ("),
    "empty": ("empty.dae", "model: mesh: 'empty.dae': found no mesh ("),
}


@pytest.mark.parametrize("what", MISSING)
def test_a_mesh_that_is_not_there_or_is_none(tmp_path, what):
    file, message = MISSING[what]
    (tmp_path / "pointer.stl").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    (tmp_path / "broken.stl").write_bytes(b"\xff" * 200)
    (tmp_path / "broken.glb").write_bytes(b"\xff" * 200)
    (tmp_path / "empty.dae").write_bytes(b"")
    refused(mini.write(tmp_path, mini.urdf(l2=mesh_off(file))), message)


def test_two_packages_are_not_taken_for_one(tmp_path):
    """Their meshes have the same path inside them, and only one package's is there."""
    names = [f"package://{name}/meshes/collision/l2.stl" for name in ("arms", "grippers")]
    write_mesh(tmp_path / "meshes" / "collision" / "l2.stl")
    path = mini.write(tmp_path, mini.urdf(l2=mesh_off(names[0]), l3=mesh_off(names[1])))
    refused(path, f"found '{names[0]}' and '{names[1]}', for which there is one file (l2.stl), allowed is one for each")
    write_mesh(tmp_path / "grippers" / "meshes" / "collision" / "l2.stl", size=(0.05, 0.05, 0.05))
    robot = read_source(path).robot
    assert robot.capsule_radius[robot.capsule_link.index(3)] < 0.05 < robot.capsule_radius[robot.capsule_link.index(2)]


def test_of_one_package_alone_the_folder_may_be_left_out(tmp_path):
    write_mesh(tmp_path / "meshes" / "l2.stl")
    write_mesh(tmp_path / "meshes" / "l3.stl")
    model = mini.urdf(l2=mesh_off("package://arms/meshes/l2.stl"), l3=mesh_off("package://grippers/meshes/l3.stl"))
    refused(mini.write(tmp_path, model), "by leaving its package out as for 'arms', allowed is that of one package")


def test_packages_that_lie_elsewhere_are_named(tmp_path):
    elsewhere = tmp_path / "elsewhere" / "arms"
    write_mesh(elsewhere / "meshes" / "l2.stl")
    path = mini.write(tmp_path / "mine", mini.urdf(l2=mesh_off("package://arms/meshes/l2.stl")))
    refused(path, "--package NAME=DIR")
    assert read_source(path, packages={"arms": elsewhere}).robot.capsule_link.count(2) == 1
    (tmp_path / "mine" / "meshes").symlink_to(elsewhere / "meshes")
    target = (elsewhere / "meshes" / "l2.stl").resolve()
    refused(
        path, f"which a link leads out of the robot file's folder to {target}, allowed are files in it or below: copy"
    )


def test_visual_shapes_where_there_are_no_others(tmp_path):
    visual = {link: mini.shape(link).replace("collision", "visual") for link in mini.LINKS}
    path = mini.write(tmp_path, mini.urdf(**visual))
    refused(path, "no moving link of the model has a shape that collides", "shapes: visual")
    seen = read_robot(mini.write(tmp_path, mini.urdf(**visual), shapes="visual"))
    np.testing.assert_array_equal(seen.capsule_radius, read_robot(mini.write(tmp_path)).capsule_radius)
    refused(mini.write(tmp_path, shapes="seen"), "shapes: found 'seen', allowed is collision or visual, or no such key")
