"""Robot models as strangers write them, MJCF or URDF, cut down to what an arm's kinematics and shapes need.

MuJoCo gets the text that is made here, and no path: the XML is parsed where entities can't expand, elements are kept
by a list, includes are spliced in, and meshes are files found in the robot file's folder, by us. So nothing in a model
reads another file, loads a plugin or runs code.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from basenet_jax.documents.fields import DocumentError, describe
from basenet_jax.robot.mesh_files import MeshFiles
from basenet_jax.robot.model_joints import ModelJoint, mjcf_joints, urdf_joints
from basenet_jax.robot.model_xml import MAX_DEPTH, XmlFiles

MAX_BODIES, MAX_SHAPES = 1000, 4000

# What stays, by the element that it stands in. Inertias are of no use here, and often wrong.
_MJCF_BODY = {"body", "frame", "joint", "freejoint", "geom", "site"}
_MJCF = {
    "mujoco": {"compiler", "default", "asset", "worldbody"},
    "default": {"default", "mesh", "joint", "geom", "site"},
    "asset": {"mesh"},
    "worldbody": _MJCF_BODY,
    "body": _MJCF_BODY,
    "frame": _MJCF_BODY,
}
_URDF = {
    "robot": {"link", "joint"},
    "link": {"collision"},
    "collision": {"origin", "geometry"},
    "geometry": {"mesh", "box", "cylinder", "sphere", "capsule"},
    "joint": {"parent", "child", "origin", "axis", "limit"},
}
_MJCF_COMPILER = {"angle", "eulerseq", "autolimits", "coordinate"}  # and what says where files are, which we follow
_LOOKS = ("material", "hfield", "user", "plugin", "rgba")  # attributes that refer to what was cut away, or to nothing
_NO_INERTIA = {"boundmass": "1", "boundinertia": "0.01"}  # of links that have none, for MuJoCo's sake


@dataclass
class ModelText:
    """A model's text, cleaned, with what it leaves out and the mesh files that it may need."""

    xml: str
    meshes: MeshFiles
    sources: tuple[Path, ...]  # the model's file and those it includes
    joints: dict[str, ModelJoint]  # by name, what MuJoCo doesn't pass on

    @property
    def files(self) -> tuple[Path, ...]:
        """All that the model is made of, as far as it was found."""
        return (*self.sources, *(mesh for mesh in self.meshes.found.values() if isinstance(mesh, Path)))


def read_model_text(
    path: Path, folder: Path, *, visual: bool = False, packages: Mapping[str, Path] = MappingProxyType({})
) -> ModelText:
    """Reads a model, the MJCF files it includes, and finds its meshes; opens nothing outside the folder and packages.

    Args:
        path: of the model.
        folder: the robot file's, in which everything has to be.
        visual: whether a URDF's visual shapes are wanted in place of those for collisions.
        packages: folders of description packages that lie elsewhere, by their names.

    Raises:
        DocumentError: a file is missing, outside the folder, too large or no XML; or it is neither MJCF nor URDF.
    """
    files = XmlFiles(folder.resolve())
    root = files.read(path)
    meshes = MeshFiles(files.folder, path.parent, packages)
    if root.tag not in ("robot", "mujoco"):
        raise DocumentError(
            f"{path.name}: found XML of <{root.tag[:40]}>, allowed are MJCF (<mujoco>) and URDF (<robot>)"
        )
    joints = _urdf(root, meshes, visual) if root.tag == "robot" else _mjcf(root, path, meshes)
    for tags, most in ((("link", "body"), MAX_BODIES), (("collision", "geom"), MAX_SHAPES)):
        if (count := sum(each.tag in tags for each in root.iter())) > most:
            raise DocumentError(
                f"{path.name}: found {count} elements <{tags[root.tag == 'mujoco']}>, allowed are {most}"
            )
    return ModelText(ElementTree.tostring(root, "unicode"), meshes, tuple(files.sources), joints)


def _prune(element: Element, kept: dict[str, set[str]]) -> None:
    allowed = kept.get(element.tag, set())
    element[:] = [child for child in element if child.tag in allowed]
    for child in element:
        _prune(child, kept)


def _urdf(root: Element, meshes: MeshFiles, visual: bool) -> dict[str, ModelJoint]:
    joints = urdf_joints(root)
    if visual:
        for link in root.findall("link"):
            link[:] = [child for child in link if child.tag == "visual"]
            for child in link:
                child.tag = "collision"
    _prune(root, _URDF)
    _check_tree(root)
    for joint in root.findall("joint"):
        if joint.get("type") in ("floating", "planar"):  # of the base, which is ours to move
            joint.set("type", "fixed")
        if joint.get("type") == "continuous":  # turns for ever, whatever its limits say
            joint[:] = [child for child in joint if child.tag != "limit"]
    for mesh in root.iter("mesh"):
        mesh.set("filename", meshes.name(mesh.get("filename", "")))
    settings = ElementTree.SubElement(root, "mujoco")
    options = {"fusestatic": "false", "strippath": "false", "discardvisual": "true", "balanceinertia": "true"}
    ElementTree.SubElement(settings, "compiler", options | _NO_INERTIA)
    return joints


def _check_tree(root: Element) -> None:
    """That links and joints form one tree, not too deep: MuJoCo would follow a cycle for ever."""
    names: set[str] = set()
    for link in root.findall("link"):
        if (name := link.get("name", "")) in names:
            raise DocumentError(f"model: found the link {describe(name)} twice, allowed is once")
        names.add(name)
    parents: dict[str, str] = {}
    for joint in root.findall("joint"):
        ends = [end.get("link", "") for name in ("parent", "child") if (end := joint.find(name)) is not None]
        where = f"model: joint {describe(joint.get('name', ''))}"
        if len(ends) != 2:
            raise DocumentError(f"{where}: found no parent or child, allowed is one of each")
        if ends[1] in parents:
            raise DocumentError(f"{where}: found a second joint to link {describe(ends[1])}, allowed is one")
        parents[ends[1]] = ends[0]
    depth: dict[str, int] = {}
    for link in parents:
        way, at = [], link
        while at in parents and at not in depth:
            depth[at] = 0  # on the way
            way.append(at)
            at = parents[at]
        if depth.get(at) == 0:
            raise DocumentError(f"model: found a cycle of links through {describe(at)}, allowed is a tree")
        depth.update((each, steps) for steps, each in enumerate(reversed(way), start=depth.get(at, 0) + 1))
    if depth and max(depth.values()) > MAX_DEPTH:
        raise DocumentError(f"model: found a chain of {max(depth.values())} links, allowed are up to {MAX_DEPTH}")


def _mjcf(root: Element, path: Path, meshes: MeshFiles) -> dict[str, ModelJoint]:
    joints = mjcf_joints(root)
    for element in root.iter():
        for attribute in _LOOKS:
            element.attrib.pop(attribute, None)
    compilers = [compiler.attrib for compiler in root.findall("compiler")]
    merged = {key: value for attributes in compilers for key, value in attributes.items()}
    _prune(root, _MJCF)
    root[:] = [child for child in root if child.tag != "compiler"]
    kept = {key: value for key, value in merged.items() if key in _MJCF_COMPILER}
    ElementTree.SubElement(root, "compiler", kept | _NO_INERTIA | {"balanceinertia": "true"})
    folder = merged.get("meshdir", merged.get("assetdir", ""))
    for mesh in root.iter("mesh"):
        if file := mesh.get("file"):
            own = Path(file).name if merged.get("strippath") == "true" else file
            mesh.attrib.setdefault("name", Path(file).stem)
            mesh.set("file", meshes.name(file, path.parent / folder / own))
            mesh.attrib.pop("content_type", None)
    return joints
