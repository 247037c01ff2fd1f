"""Robot models as strangers write them, MJCF or URDF, cut down to what an arm's kinematics and shapes need.

MuJoCo gets the text that is made here, and no path: the XML is parsed where entities can't expand, elements are kept
by a list, includes are spliced in, and meshes are files found in the robot file's folder, by us. So nothing in a model
reads another file, loads a plugin or runs code.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import defusedxml
import defusedxml.ElementTree

from basenet_jax.documents.fields import DocumentError, describe
from basenet_jax.documents.text_files import inside

MAX_XML_BYTES = 4 * 1024 * 1024
MAX_MESH_BYTES = 32 * 1024 * 1024
MAX_DEPTH = 128  # of elements; MuJoCo's reader and ours are recursive
MAX_INCLUDES = 64
MESH_SUFFIXES = (".stl", ".obj", ".msh")

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


@dataclass
class ModelText:
    """A model's text, cleaned, and the mesh files that it may need."""

    xml: str
    is_urdf: bool
    meshes: dict[str, Path | str] = field(default_factory=dict)  # by the name in the text; a text: what is missing
    sources: tuple[Path, ...] = ()  # the model's file and those it includes

    @property
    def files(self) -> tuple[Path, ...]:
        """All that the model is made of, as far as it was found."""
        return (*self.sources, *(mesh for mesh in self.meshes.values() if isinstance(mesh, Path)))


def read_model_text(path: Path, folder: Path) -> ModelText:
    """Reads a model, the MJCF files it includes, and finds its meshes; opens nothing outside the folder.

    Args:
        path: of the model.
        folder: the robot file's, in which everything has to be.

    Raises:
        DocumentError: a file is missing, outside the folder, too large or no XML; or it is neither MJCF nor URDF.
    """
    root = _parse(path)
    meshes = _Meshes(folder.resolve(), path.parent)
    if root.tag == "robot":
        return _urdf(root, path, meshes)
    if root.tag == "mujoco":
        return _mjcf(root, path, meshes)
    raise DocumentError(f"{path.name}: found XML of <{root.tag[:40]}>, allowed are MJCF (<mujoco>) and URDF (<robot>)")


def _parse(path: Path) -> ElementTree.Element:
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_XML_BYTES + 1)
    except OSError as error:
        raise DocumentError(f"{path.name}: can't be read: {error.strerror}") from None
    if len(data) > MAX_XML_BYTES:
        raise DocumentError(f"{path.name}: found more than {MAX_XML_BYTES} bytes, allowed are up to {MAX_XML_BYTES}")
    try:
        root = defusedxml.ElementTree.fromstring(data, forbid_dtd=True)
    except ElementTree.ParseError as error:
        raise DocumentError(f"{path.name}: no XML: {error}") from None
    except defusedxml.DefusedXmlException as error:
        found = "an entity or document type" if not str(error) else str(error).split("(")[0]
        raise DocumentError(f"{path.name}: found {found}, allowed is XML without") from None
    except (ValueError, LookupError) as error:  # an unknown encoding
        raise DocumentError(f"{path.name}: no XML: {error}") from None
    _check_depth(root, path)
    return root


def _check_depth(root: ElementTree.Element, path: Path) -> None:
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise DocumentError(f"{path.name}: found more than {MAX_DEPTH} levels of elements, allowed are up to these")
        level = [child for element in level for child in element]


class _Meshes:
    """Finds mesh files and gives them names of ours."""

    def __init__(self, folder: Path, beside: Path):
        self.folder, self.beside = folder, beside
        self.files: dict[str, Path | str] = {}
        self._names: dict[str, str] = {}

    def name(self, file: str, places: list[Path]) -> str:
        """Our name for a mesh; whether it is there matters only if it is used."""
        if file not in self._names:
            suffix = Path(file).suffix.lower()
            self._names[file] = f"mesh{len(self._names)}{suffix if suffix in MESH_SUFFIXES else '.stl'}"
            self.files[self._names[file]] = self._find(file, suffix, places)
        return self._names[file]

    def _find(self, file: str, suffix: str, places: list[Path]) -> Path | str:
        if suffix not in MESH_SUFFIXES:
            return f"found {describe(file)}, allowed are {', '.join(MESH_SUFFIXES)}"
        for place in places:
            if found := inside(place, self.folder):
                if found.stat().st_size > MAX_MESH_BYTES:
                    return f"found {describe(file)} of {found.stat().st_size} bytes, allowed are up to {MAX_MESH_BYTES}"
                return found
        return f"found {describe(file)}, which is no file in the robot file's folder, allowed are files in it or below"


def _prune(element: ElementTree.Element, kept: dict[str, set[str]]) -> None:
    allowed = kept.get(element.tag, set())
    for child in list(element):
        if child.tag not in allowed:
            element.remove(child)
        else:
            _prune(child, kept)


def _urdf(root: ElementTree.Element, path: Path, meshes: _Meshes) -> ModelText:
    _prune(root, _URDF)
    _check_tree(root)
    for mesh in root.iter("mesh"):
        file = mesh.get("filename", "")
        # package://name/path: the package's own folder isn't known, so leading folders are left out one by one.
        parts = re.sub(r"^(package|file|model)://", "", file).lstrip("/").split("/")
        tails = ["/".join(parts[first:]) for first in range(len(parts))]
        mesh.set("filename", meshes.name(file, [at / tail for tail in tails for at in (meshes.beside, meshes.folder)]))
    settings = ElementTree.SubElement(root, "mujoco")
    options = {"fusestatic": "false", "strippath": "false", "discardvisual": "true", "balanceinertia": "true"}
    ElementTree.SubElement(settings, "compiler", options | _NO_INERTIA)
    return ModelText(ElementTree.tostring(root, "unicode"), True, meshes.files, (path,))


_NO_INERTIA = {"boundmass": "1", "boundinertia": "0.01"}  # of links that have none, for MuJoCo's sake


def _check_tree(root: ElementTree.Element) -> None:
    """That links and joints form one tree: MuJoCo would follow a cycle for ever."""
    parents: dict[str, str] = {}
    for joint in root.findall("joint"):
        ends = [end.get("link", "") for name in ("parent", "child") if (end := joint.find(name)) is not None]
        where = f"model: joint {describe(joint.get('name', ''))}"
        if len(ends) != 2:
            raise DocumentError(f"{where}: found no parent or child, allowed is one of each")
        if ends[1] in parents:
            raise DocumentError(f"{where}: found a second joint to link {describe(ends[1])}, allowed is one")
        parents[ends[1]] = ends[0]
    for link in parents:
        seen, at = {link}, link
        while at in parents:
            at = parents[at]
            if at in seen:
                raise DocumentError(f"model: found a cycle of links through {describe(link)}, allowed is a tree")
            seen.add(at)


def _mjcf(root: ElementTree.Element, path: Path, meshes: _Meshes) -> ModelText:
    included: list[Path] = []
    _include(root, path, meshes.folder, (path.resolve(),), included)
    for element in root.iter():
        for attribute in _LOOKS:
            element.attrib.pop(attribute, None)
    compilers = [compiler.attrib for compiler in root.findall("compiler")]
    merged = {key: value for attributes in compilers for key, value in attributes.items()}
    _prune(root, _MJCF)
    for compiler in root.findall("compiler"):
        root.remove(compiler)
    kept = {key: value for key, value in merged.items() if key in _MJCF_COMPILER}
    ElementTree.SubElement(root, "compiler", kept | _NO_INERTIA | {"balanceinertia": "true"})
    folder = merged.get("meshdir", merged.get("assetdir", ""))
    for mesh in root.iter("mesh"):
        if file := mesh.get("file"):
            own = Path(file).name if merged.get("strippath") == "true" else file
            mesh.attrib.setdefault("name", Path(file).stem)
            mesh.set("file", meshes.name(file, [path.parent / folder / own]))
            mesh.attrib.pop("content_type", None)
    return ModelText(ElementTree.tostring(root, "unicode"), False, meshes.files, (path, *included))


def _include(
    element: ElementTree.Element, path: Path, folder: Path, above: tuple[Path, ...], included: list[Path]
) -> None:
    """Puts the content of included files in the place of <include>, wherever it stands, and lists them."""
    for index, child in reversed(list(enumerate(element))):
        if child.tag != "include":
            _include(child, path, folder, above, included)
            continue
        file = child.get("file", "")
        found = inside(path.parent / file, folder)
        if found is None:
            raise DocumentError(f"model: include: found {describe(file)}, allowed are files in the robot file's folder")
        if found in above or len(included) == MAX_INCLUDES:
            what = "an include of itself" if found in above else f"more than {MAX_INCLUDES} includes"
            raise DocumentError(f"model: include: found {what} ({describe(file)}), allowed are {MAX_INCLUDES} without")
        included.append(found)
        content = _parse(found)
        _include(content, path, folder, (*above, found), included)
        element[index : index + 1] = list(content)
