"""What a model's text says of its joints and MuJoCo doesn't pass on: mimics, missing limits, speeds."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

from basenet_jax.documents.fields import describe, field_error

_ROUNDED = 1.001  # files round


class ModelJoint(NamedTuple):
    """A joint as the text has it."""

    kind: str = "hinge"  # URDF's type
    mimics: str | None = None  # the joint that moves this one
    limited: bool = True
    velocity: float | None = None  # the maker's, rad/s or m/s
    parent: str = ""  # links of URDF
    child: str = ""


def urdf_joints(root: Element) -> dict[str, ModelJoint]:
    """The joints of a URDF, before it is cut down."""
    joints = {}
    for joint in root.findall("joint"):
        limit, mimic = joint.find("limit"), joint.find("mimic")
        ends = [end.get("link", "") if (end := joint.find(tag)) is not None else "" for tag in ("parent", "child")]
        joints[joint.get("name", "")] = ModelJoint(
            kind=joint.get("type", ""),
            mimics=None if mimic is None else mimic.get("joint", ""),
            limited=limit is not None and ("lower" in limit.attrib or "upper" in limit.attrib),
            velocity=None if limit is None else _positive(limit.get("velocity")),
            parent=ends[0],
            child=ends[1],
        )
    return joints


def mjcf_joints(root: Element) -> dict[str, ModelJoint]:
    """The joints that an MJCF's equalities move."""
    equalities = (each for group in root.findall("equality") for each in group.findall("joint"))
    return {
        each.get("joint1", ""): ModelJoint(mimics=each.get("joint2", "a constant"))
        for each in equalities
        if each.get("active") != "false"
    }


def check_joint_texts(names: Sequence[str], joints: dict[str, ModelJoint]) -> None:
    """That an arm's joints move by themselves, and within limits that are given.

    Raises:
        DocumentError: one doesn't; the message names it.
    """
    for index, name in enumerate(names):
        joint = joints.get(name, ModelJoint())
        what = f"joints[{index}]"
        if joint.mimics is not None:
            found = f"{describe(name)}, which the model moves with {describe(joint.mimics)}"
            raise field_error(what, found, "are joints that move by themselves (no mimic, no equality)")
        if joint.kind in ("revolute", "prismatic") and not joint.limited:
            found = f"{describe(name)}, a {joint.kind} joint whose <limit> gives no lower or upper"
            turns = ", or the type continuous" if joint.kind == "revolute" else ""
            raise field_error(what, found, f"are limits in the model{turns}")


def check_chain(field: str, arm_base: str, tool: str, joints: dict[str, ModelJoint]) -> None:
    """That no joint between two links of a URDF moves in several ways: such joints are taken for fixed elsewhere.

    Raises:
        DocumentError: one does; the message names it.
    """
    above = {joint.child: (name, joint) for name, joint in joints.items()}
    link, left = tool, len(joints)
    while link != arm_base and link in above and left:
        name, joint = above[link]
        if joint.kind in ("floating", "planar"):
            found = f"{describe(tool)}, behind the {joint.kind} joint {describe(name)}"
            raise field_error(field, found, "is a frame that hinges and slides carry")
        link, left = joint.parent, left - 1


def joint_notes(
    names: Sequence[str], speeds: Sequence[float], unlimited: Sequence[bool], joints: dict[str, ModelJoint]
) -> Iterator[str]:
    """Yields what is unusual of an arm's joints, a line each.

    Args:
        names: of the joints.
        speeds: of the robot file (rad/s or m/s).
        unlimited: which of them have no limits.
        joints: as the text has them.
    """
    for name, speed, free in zip(names, speeds, unlimited, strict=True):
        if free:
            yield f"{name} has no limits in the model: it is planned with a whole turn either way"
        velocity = joints.get(name, ModelJoint()).velocity
        if velocity is not None and speed > velocity * _ROUNDED:
            yield f"{name} is planned with {speed:g} /s, and its model allows {velocity:g} /s: see joint_speed"


def _positive(text: str | None) -> float | None:
    try:
        value = float(text or 0)
    except ValueError:
        return None
    return value if 0 < value < float("inf") else None
