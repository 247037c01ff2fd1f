"""The MJCF of a mobile manipulator, written from what was read: base, body box, arm and capsules, in primitive shapes.

MuJoCo and MJX replay and draw this model. Numbers are written in full, which MuJoCo's own writer doesn't do.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

from collections.abc import Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from basenet_jax.robot.capsule_fit import Fit
from basenet_jax.robot.model import Robot
from basenet_jax.robot.self_contact import PEDESTAL_HALF_M

BASE, BODY, PEDESTAL, ARM_BASE, TOOL_SITE = "base", "body", "pedestal", "arm base", "tool0"
BASE_JOINTS = ("base_x", "base_y", "base_heading")
_DARK, _LIGHT, _MARK = "0.25 0.27 0.30 1", "0.75 0.77 0.80 1", "0.95 0.6 0.1 1"
_BONE_M = 0.04  # the radius of links that have no shape
_MARK_HALF_M = (0.02, 0.01)  # half the front mark's length along x and its height
_SHORT_M = 1e-6  # a capsule shorter than this is a sphere


def capsule_name(index: int) -> str:
    """What the model calls a capsule of the robot's arrays."""
    return f"capsule {index}"


def write_mjcf(robot: Robot, stays: Iterable[tuple[int, Fit]] = ()) -> str:
    """The model as text.

    Args:
        robot: its arrays.
        stays: shapes that are drawn and tested against nothing, each with its link.
    """
    root = Element("mujoco", model=robot.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(SubElement(root, "default"), "geom", contype="0", conaffinity="0", density="500")
    base = SubElement(SubElement(root, "worldbody"), "body", name=BASE)
    for name, kind, axis in zip(BASE_JOINTS, ("slide", "slide", "hinge"), np.eye(3), strict=True):
        SubElement(base, "joint", name=name, type=kind, axis=_text(axis))
    _add_body_shapes(base, robot)
    link = SubElement(base, "body", {"name": ARM_BASE} | _placed(robot.mount_rotation, robot.mount_position))
    shapes = dict(enumerate(zip(robot.capsule_link, _fits(robot), strict=True)))
    drawn = list(stays)
    for number in range(robot.dof + 1):
        own = [(capsule_name(index), fit) for index, (owner, fit) in shapes.items() if owner == number]
        own += [(f"shape {number} {index}", fit) for index, (owner, fit) in enumerate(drawn) if owner == number]
        if number < robot.dof:
            own = own or [(f"bone {number}", Fit(np.zeros(3), np.asarray(robot.joint_position[number]), _BONE_M))]
        for name, fit in own:
            _add_capsule(link, name, fit)
        if not own:
            SubElement(link, "inertial", pos="0 0 0", mass="0.1", diaginertia="1e-4 1e-4 1e-4")
        if number < robot.dof:
            link = _add_link(link, robot, number)
    SubElement(link, "site", {"name": TOOL_SITE} | _placed(robot.tool_rotation, robot.tool_position))
    return ElementTree.tostring(root, "unicode")


def _add_body_shapes(base: Element, robot: Robot) -> None:
    """The body box, a pedestal from its top to the arm where there is room, and a mark at the front."""
    center, half = np.asarray(robot.body_center), np.asarray(robot.body_half_size)
    SubElement(base, "geom", name=BODY, type="box", size=_text(half), pos=_text(center), rgba=_DARK)
    top, mount = center[2] + half[2], np.asarray(robot.mount_position)
    if mount[2] > top:
        size, pos = (PEDESTAL_HALF_M, PEDESTAL_HALF_M, (mount[2] - top) / 2), (*mount[:2], (mount[2] + top) / 2)
        SubElement(base, "geom", name=PEDESTAL, type="box", size=_text(size), pos=_text(pos), rgba=_DARK)
    long, high = _MARK_HALF_M
    size, pos = (long, 0.6 * half[1], high), (center[0] + half[0] - 1.5 * long, center[1], top + high)
    SubElement(base, "geom", name="front_mark", type="box", size=_text(size), pos=_text(pos), rgba=_MARK)


def _add_link(parent: Element, robot: Robot, joint: int) -> Element:
    placed = _placed(robot.joint_rotation[joint], robot.joint_position[joint])
    link = SubElement(parent, "body", {"name": f"link {joint + 1}"} | placed)
    limits = (robot.joint_lower[joint], robot.joint_upper[joint])
    kind = "slide" if robot.prismatic[joint] else "hinge"
    SubElement(link, "joint", name=robot.joint_names[joint], type=kind, axis="0 0 1", range=_text(limits))
    return link


def _add_capsule(link: Element, name: str, fit: Fit) -> None:
    attributes = {"name": name, "rgba": _LIGHT}
    if np.linalg.norm(fit.end - fit.start) < _SHORT_M:
        SubElement(link, "geom", attributes | {"type": "sphere", "size": _text([fit.radius]), "pos": _text(fit.start)})
        return
    ends = _text([*fit.start, *fit.end])
    SubElement(link, "geom", attributes | {"type": "capsule", "size": _text([fit.radius]), "fromto": ends})


def _fits(robot: Robot) -> list[Fit]:
    ends = zip(robot.capsule_start, robot.capsule_end, robot.capsule_radius, strict=True)
    return [Fit(np.asarray(start), np.asarray(end), float(radius)) for start, end, radius in ends]


def _placed(rotation, position) -> dict[str, str]:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.asarray(rotation, float).ravel())
    return {"pos": _text(position), "quat": _text(quaternion)}


def _text(numbers) -> str:
    return " ".join(repr(float(number)) for number in numbers)
