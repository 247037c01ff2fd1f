"""XML of models as strangers write it, read within bounds: without entities, neither endless nor deep."""

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import defusedxml
import defusedxml.ElementTree

from basenet_jax.documents.fields import DocumentError, describe
from basenet_jax.documents.text_files import inside

MAX_XML_BYTES = 4 * 1024 * 1024  # of a file
MAX_ALL_BYTES = 2 * MAX_XML_BYTES  # of a model with what it includes
MAX_ELEMENTS = 20_000  # likewise
MAX_DEPTH = 128  # of elements; MuJoCo's reader and ours are recursive
MAX_INCLUDES = 64
LFS = b"version https://git-lfs"  # how a file begins that stands for one kept elsewhere
_XACRO = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}", "xacro:")


@dataclass
class XmlFiles:
    """Reads a model's files, and counts what they come to together."""

    folder: Path  # the robot file's, in which everything has to be
    sources: list[Path] = field(default_factory=list)
    size: int = 0
    elements: int = 0

    def read(self, path: Path) -> Element:
        """The content of the model's file, with included files in the place of <include>, wherever that stands.

        Raises:
            DocumentError: a file is missing, outside the folder, no XML or still xacro; or it is all too large or deep.
        """
        root = self._parse(path)
        self._include(root, path, (path.resolve(),), 1)
        return root

    def _parse(self, path: Path) -> Element:
        try:
            with path.open("rb") as stream:
                data = stream.read(MAX_XML_BYTES + 1)
        except OSError as error:
            raise DocumentError(f"{path.name}: can't be read: {error.strerror}") from None
        self.size += len(data)
        if len(data) > MAX_XML_BYTES or self.size > MAX_ALL_BYTES:
            most = MAX_XML_BYTES if len(data) > MAX_XML_BYTES else MAX_ALL_BYTES
            whole = "" if most == MAX_XML_BYTES else " with what is included"
            raise DocumentError(f"{path.name}: found more than {most} bytes{whole}, allowed are up to {most}")
        root = _parse_bytes(data, path.name)
        self.sources.append(path)
        self.elements += _count(root, path.name)
        if self.elements > MAX_ELEMENTS:
            raise DocumentError(f"{path.name}: found more than {MAX_ELEMENTS} elements, allowed are up to these")
        return root

    def _include(self, element: Element, path: Path, above: tuple[Path, ...], depth: int) -> None:
        """Puts included files in the place of <include>; none is included deeper than elements may stand."""
        if depth > MAX_DEPTH:
            raise _too_deep(path.name)
        for index, child in reversed(list(enumerate(element))):
            if child.tag != "include":
                self._include(child, path, above, depth + 1)
                continue
            file = child.get("file", "")
            found = inside(path.parent / file, self.folder)
            if found is None:
                raise DocumentError(
                    f"model: include: found {describe(file)}, allowed are files in the robot file's folder"
                )
            if found in above or len(self.sources) > MAX_INCLUDES:
                what = "an include of itself" if found in above else f"more than {MAX_INCLUDES} includes"
                raise DocumentError(
                    f"model: include: found {what} ({describe(file)}), allowed are {MAX_INCLUDES} without"
                )
            content = self._parse(found)
            self._include(content, path, (*above, found), depth)
            element[index : index + 1] = list(content)


def _parse_bytes(data: bytes, name: str) -> Element:
    if data.startswith(LFS):
        raise DocumentError(f"{name}: found a git-lfs pointer in place of the file, allowed is XML: run git lfs pull")
    try:
        root = defusedxml.ElementTree.fromstring(data, forbid_dtd=True)
    except ElementTree.ParseError as error:
        if b"xacro:" in data:
            raise _xacro(name) from None
        hint = " (remove what stands before <?xml ...?>)" if "not at start of entity" in str(error) else ""
        raise DocumentError(f"{name}: no XML: {error}{hint}") from None
    except defusedxml.DefusedXmlException as error:
        found = "an entity or document type" if not str(error) else str(error).split("(")[0]
        raise DocumentError(f"{name}: found {found}, allowed is XML without") from None
    except (ValueError, LookupError) as error:  # an unknown encoding
        raise DocumentError(f"{name}: no XML: {error}") from None
    if any(each.tag.startswith(_XACRO) or any("${" in value for value in each.attrib.values()) for each in root.iter()):
        raise _xacro(name)
    return root


def _count(root: Element, name: str) -> int:
    """How many elements there are, none of them deeper than is allowed."""
    level, depth, count = [root], 0, 0
    while level:
        depth, count = depth + 1, count + len(level)
        if depth > MAX_DEPTH:
            raise _too_deep(name)
        level = [child for element in level for child in element]
    return count


def _too_deep(name: str) -> DocumentError:
    return DocumentError(f"{name}: found more than {MAX_DEPTH} levels of elements, allowed are up to these")


def _xacro(name: str) -> DocumentError:
    return DocumentError(f"{name}: found xacro, allowed is plain URDF: expand it first (xacro {name} > arm.urdf)")
