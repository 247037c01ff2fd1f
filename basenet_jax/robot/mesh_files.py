"""The mesh files that a model names: found where they may be, one file for one name, and read as what MuJoCo takes."""

import io
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import defusedxml.ElementTree
import numpy as np

from basenet_jax.documents.fields import DocumentError
from basenet_jax.documents.text_files import inside
from basenet_jax.robot.capsule_fit import extreme_points
from basenet_jax.robot.model_xml import LFS

MAX_MESH_BYTES = 32 * 1024 * 1024
MAX_ALL_MESH_BYTES = 3 * MAX_MESH_BYTES
NATIVE = ".msh"  # MuJoCo's own kind
MESH_SUFFIXES = (".stl", ".obj", ".dae", ".glb", ".ply", NATIVE)
_MAX_PARTS, _LONGEST = 32, 200  # of a path: its folders, and its characters in messages


class MeshFiles:
    """Finds meshes, gives them names of ours, and reads them.

    Attributes:
        found: by our name, the file; or a text that says what is missing.
    """

    def __init__(self, folder: Path, beside: Path, packages: Mapping[str, Path]):
        """Args: the robot file's folder, the model's, and by their names packages that lie elsewhere."""
        self.found: dict[str, Path | str] = {}
        self._folder, self._beside, self._packages = folder, beside, packages
        self._names: dict[str, str] = {}  # ours, by the model's
        self._taken: dict[Path, tuple[str, list[str]]] = {}  # which mesh a file was taken for first
        self._own: str | None = None  # the package whose folder is the robot file's or the model's
        self._read = 0

    def name(self, reference: str, place: Path | None = None) -> str:
        """Our name for a mesh; whether it is there matters only if it is used.

        Args:
            reference: as the model names it.
            place: where it must be; None in URDF, where a package's folder isn't known.
        """
        if reference not in self._names:
            path = reference.replace("\\", "/")
            suffix = Path(path).suffix.lower()
            own = f"mesh{len(self._names)}{suffix if suffix == NATIVE else '.stl'}"
            self._names[reference] = own
            self.found[own] = self._find(reference, path, suffix, place)
        return self._names[reference]

    def reference(self, own: str) -> str:
        """What the model calls a mesh, for messages."""
        return next((_short(reference) for reference, name in self._names.items() if name == own), own)

    def read(self, own: str) -> bytes:
        """The content of a mesh as MuJoCo takes it: its convex hull, thinned out where that has very many points.

        Raises:
            DocumentError: it is missing, too large, or holds no mesh.
        """
        found = self.found.get(own, "a mesh that names no file")
        if isinstance(found, str):
            raise _mesh_error(found)
        data = found.read_bytes()
        self._read += len(data)
        if self._read > MAX_ALL_MESH_BYTES:
            raise _mesh_error(f"found meshes of {self._read} bytes, allowed are up to {MAX_ALL_MESH_BYTES} together")
        if data.startswith(LFS):
            what = f"found a git-lfs pointer in place of {self.reference(own)}"
            raise _mesh_error(f"{what}, allowed is the mesh: run git lfs pull")
        suffix = found.suffix.lower()
        if suffix == NATIVE:
            return data
        try:
            return _hull(data, suffix[1:])
        except Exception as error:  # readers of other people's formats raise whatever they meet
            message = " ".join(str(error).split())[:_LONGEST]
            raise _mesh_error(f"{self.reference(own)}: found no mesh ({message}), allowed is {suffix}") from None

    def _find(self, reference: str, path: str, suffix: str, place: Path | None) -> Path | str:
        if suffix not in MESH_SUFFIXES:
            return f"found {_short(reference)}, allowed are {', '.join(MESH_SUFFIXES)}"
        if path.count("/") > _MAX_PARTS:
            return f"found {_short(reference)}, a path of {path.count('/')} folders, allowed are up to {_MAX_PARTS}"
        package = match[1] if (match := re.match(r"(?:package|model)://([^/]+)/", path)) else None
        parts = re.sub(r"^(package|file|model)://", "", path).lstrip("/").split("/")
        given = self._packages.get(package or "")
        if place is not None:
            places = [(place, self._folder)]
        elif given is not None:
            places = [(given.joinpath(*parts[1:]), given.resolve())]
        else:
            # The package's own folder isn't known, so leading folders are left out one by one.
            tails = [Path(*parts[first:]) for first in range(len(parts))]
            places = [(at / tail, self._folder) for tail in tails for at in (self._beside, self._folder)]
        for at, root in places:
            if found := inside(at, root):
                fault = self._mistaken(reference, parts, package, found) if place is None and given is None else None
                return fault or _of_size(reference, found)
        missing = (
            f"found {_short(reference)}, which is no file in the robot file's folder, allowed are files in it or below"
        )
        elsewhere = " (or name its package's folder: --package NAME=DIR)"
        for at, _ in places:
            if (target := _resolved(at)) is not None:
                how = "a link leads" if str(target) != os.path.normpath(at.absolute()) else "leads"
                missing = f"found {_short(reference)}, which {how} out of the robot file's folder to {target}"
                return f"{missing}, allowed are files in it or below: copy them there{elsewhere}"
        return missing + (elsewhere if package else "")

    def _mistaken(self, reference: str, parts: list[str], package: str | None, found: Path) -> str | None:
        """What says that a file that was found by the end of its path may be another's."""
        allowed = "put each package in a folder of its name, or name it: --package NAME=DIR"
        other, path = self._taken.setdefault(found, (reference, parts))
        shorter, longer = sorted((path, parts), key=len)
        if longer[len(longer) - len(shorter) :] != shorter:
            one = f"for which there is one file ({found.name})"
            return f"found {_short(other)} and {_short(reference)}, {one}, allowed is one for each: {allowed}"
        if package and package not in found.parts:
            if self._own is None:
                self._own = package
            if package != self._own:
                what = f"found {_short(reference)}, by leaving its package out as for {_short(self._own)}"
                return f"{what}, allowed is that of one package: {allowed}"
        return None


def _of_size(reference: str, found: Path) -> Path | str:
    if (size := found.stat().st_size) > MAX_MESH_BYTES:
        return f"found {_short(reference)} of {size} bytes, allowed are up to {MAX_MESH_BYTES}"
    return found


def _mesh_error(message: str) -> DocumentError:
    return DocumentError(
        f"model: mesh: {message} (or give the arm's shape as capsules in the robot file; then no mesh is read)"
    )


def _short(reference: str) -> str:
    return repr(reference if len(reference) <= _LONGEST else f"...{reference[-_LONGEST:]}")


def _resolved(path: Path) -> Path | None:
    try:
        return path.resolve() if path.is_file() else None
    except (OSError, ValueError, RuntimeError):
        return None


def _hull(data: bytes, kind: str) -> bytes:
    """The convex hull of all that a file holds, in m, as binary STL; like RViz, without turning y-up files."""
    import trimesh  # takes a third of a second, and few models need it

    unit = _collada_unit(data) if kind == "dae" else 1.0
    scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False)
    hull = trimesh.convex.convex_hull(extreme_points(unit * np.asarray(scene.to_mesh().vertices)))
    return hull.export(file_type="stl")


def _collada_unit(data: bytes) -> float:
    root = defusedxml.ElementTree.fromstring(data, forbid_dtd=True)
    unit = next((each for each in root.iter() if each.tag.rpartition("}")[2] == "unit"), None)
    return 1.0 if unit is None else float(unit.get("meter", 1.0))
