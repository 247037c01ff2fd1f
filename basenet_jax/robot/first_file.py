"""A first robot file for a model that has none: its chain as it is read, and the rest found by search or guessed.

Home and stow are one posture: the gripper straight down over the deck, the arm clear of the body and of tables.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float
from msgspec import convert

from basenet_jax.documents.fields import DocumentError, describe, field_error
from basenet_jax.documents.yaml_text import to_yaml
from basenet_jax.robot.fields import GRASP_DEPTH_M, MAX_JOINTS, MIN_JOINTS, RobotFile
from basenet_jax.robot.ik import solve_ik
from basenet_jax.robot.model import Robot
from basenet_jax.robot.model_arm import compile_model
from basenet_jax.robot.model_joints import ModelJoint
from basenet_jax.robot.model_text import read_model_text
from basenet_jax.robot.reading import read_fields
from basenet_jax.robot.rest import check_tables
from basenet_jax.robot.set_up import set_up_faults
from basenet_jax.robot.tool import nearest_turn

_TABLE_M = 0.75  # the default table's top
_TOOLS = ("tool0", "tcp", "tool", "grasp", "attachment", "flange", "hand", "gripper", "ee")  # in names, best first
_FINGERS = ("jaw", "finger", "grip", "claw", "knuckle")  # in the names of joints that close a gripper
_SENSORS = ("camera", "sensor", "optical", "range", "laser")
_TIPS = ("tcp", "grasp", "tip")  # in the names of frames where the fingers meet
_SPEED, _ACCELERATION = 1.0, 1.4
_BASE: dict[str, Any] = {
    "footprint": [0.8, 0.5],
    "body": {"center": [0.0, 0.0, 0.375], "size": [0.8, 0.5, 0.75]},
    "speed": {"linear": 0.5, "angular": 0.5},
    "acceleration": {"linear": 0.5, "angular": 1.0},
}
_DECK = {"center": [0.15, 0.05], "size": [0.45, 0.35]}
_MOUNTS = tuple(itertools.product((0.9, 0.8, 1.0, 1.15), ((-0.25, -0.15), (-0.25, 0.0), (0.0, 0.0))))
_ABOVE_M = (0.15, 0.3)  # the fingers above the body's top at stow
_GRIPPER_M = 0.02  # a tool frame nearer to the last joint doesn't say where the gripper points
_YAWS, _SEEDS = 8, 64


class Chain(NamedTuple):
    """An arm that was found in a model."""

    arm_base: str
    tool: str
    joints: tuple[str, ...]
    others: tuple[str, ...]  # frames that would have done as the tool


def write_first_file(
    model: Path, out: Path, *, arm_base: str | None, tool: str | None, packages: Mapping[str, Path]
) -> tuple[str, Chain]:
    """The text of a robot file for a model, and the arm that it is about.

    Args:
        model: an MJCF or URDF.
        out: where the robot file will stand, in the model's folder or above.
        arm_base: a frame of the model; None: the one before the arm's first joint.
        tool: likewise; None: the likeliest.
        packages: folders of description packages that lie elsewhere, by their names.

    Raises:
        DocumentError: the model can't be read, has no such arm, or no posture is found.
    """
    folder, model = out.resolve().parent, model.resolve()
    if not model.is_relative_to(folder):
        raise field_error("--out", describe(str(out)), "are files in the model's folder or in one above it")
    text = read_model_text(model, folder, packages=packages)
    compiled = compile_model(text, joints=("",), arm_base="", shapes=None)
    chain = find_chain(compiled, text.joints, arm_base, tool)
    speeds = [min(text.joints.get(name, ModelJoint()).velocity or _SPEED, 20.0) for name in chain.joints]
    limits = [_middle(compiled, name) for name in chain.joints]
    content: dict[str, Any] = {
        "format": "basenet-robot/1",
        "name": "".join(letter if letter.isalnum() else "_" for letter in model.stem).strip("_")[:64] or "my_robot",
        "model": str(model.relative_to(folder)),
        "frames": {"arm_base": chain.arm_base},
        "tool": {"frame": chain.tool},
        "grasp_depth": 0.0 if any(part in chain.tool.lower() for part in _TIPS) else GRASP_DEPTH_M,
        "joints": list(chain.joints),
        "joint_speed": speeds,
        "joint_acceleration": [_ACCELERATION] * len(speeds),
        "home_degrees": limits,
        "stow_degrees": [*limits],
        "mount": {"position": [-0.25, -0.15, 0.9]},
        "deck": _DECK,
        "base": _BASE,
    }
    try:
        posed = _posed(content, out, packages)
    except DocumentError as error:
        if not str(error).startswith("capsules: found none"):
            raise
        posed = _posed({**content, "shapes": "visual"}, out, packages)
    return _commented(posed, chain, text.joints), chain


def find_chain(
    model: mujoco.MjModel, joints: Mapping[str, ModelJoint], arm_base: str | None, tool: str | None
) -> Chain:
    """The arm between two frames, or the likeliest one: the longest chain that ends in a hinge and a tool's name.

    Raises:
        DocumentError: there is none of 6 joints or more.
    """
    frames = {model.body(i).name: i for i in range(1, model.nbody)}
    frames |= {model.site(i).name: int(model.site_bodyid[i]) for i in range(model.nsite)}
    frames.pop("", None)
    if tool is not None and tool not in frames:
        raise field_error("--tool", describe(tool), f"are the model's sites and bodies: {', '.join(list(frames)[:30])}")
    chains = {name: _moving(model, body, joints) for name, body in frames.items() if tool in (None, name)}
    long = {name: own for name, own in chains.items() if len(own) >= MIN_JOINTS}
    if not long:
        most = max(map(len, chains.values()), default=0)
        found = f"{most} joints in a row at most"
        raise field_error("model", found, f"are arms of {MIN_JOINTS} or more, whose last joint is no finger's")

    def rank(name: str) -> tuple[int, int, int]:
        known = next((index for index, part in enumerate(_TOOLS) if part in name.lower()), len(_TOOLS))
        known += len(_TOOLS) * any(part in name.lower() for part in _SENSORS)
        return -min(len(long[name]), MAX_JOINTS), known, -_depth(model, frames[name])

    best = min(long, key=rank)
    own = long[best]
    if arm_base is not None:
        if arm_base not in frames:
            allowed = f"are the model's sites and bodies: {', '.join(list(frames)[:30])}"
            raise field_error("--arm-base", describe(arm_base), allowed)
        carried = set(_moving(model, frames[arm_base], joints))
        own = [joint for joint in own if joint not in carried]
    own = own if len(own) <= MAX_JOINTS else own[-(MAX_JOINTS - 1) :]
    base = model.body(int(model.body_parentid[model.jnt_bodyid[own[0]]])).name
    others = tuple(name for name in sorted(long, key=rank) if name != best and len(long[name]) >= MIN_JOINTS)
    return Chain(arm_base or base, best, tuple(model.joint(joint).name for joint in own), others)


def _moving(model: mujoco.MjModel, body: int, joints: Mapping[str, ModelJoint]) -> list[int]:
    """The hinges and slides from the world to a body; none where its last one is a finger's, or moves with another."""
    found: list[int] = []
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        found = [*range(first, first + count), *found]
        body = int(model.body_parentid[body])
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    found = [joint for joint in found if int(model.jnt_type[joint]) in single]
    name = model.joint(found[-1]).name.lower() if found else ""
    if found and (int(model.jnt_type[found[-1]]) == single[1] or any(part in name for part in _FINGERS)):
        return []
    mimics = any(joints.get(model.joint(joint).name, ModelJoint()).mimics for joint in found)
    return [] if mimics else found


def _depth(model: mujoco.MjModel, body: int) -> int:
    depth = 0
    while body:
        body, depth = int(model.body_parentid[body]), depth + 1
    return depth


def _middle(model: mujoco.MjModel, name: str) -> float:
    """Of a joint's range, in degrees or m."""
    joint = model.joint(name).id
    middle = float(np.mean(model.jnt_range[joint])) if model.jnt_limited[joint] else 0.0
    return middle if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else float(np.degrees(middle))


def _posed(content: dict[str, Any], out: Path, packages: Mapping[str, Path]) -> dict[str, Any]:
    """The content with a tool rotation, mount, home and stow that pass all checks."""
    robot = read_fields(convert(content, RobotFile), out, packages=packages).robot
    rotation, away = np.asarray(robot.tool_rotation), np.asarray(robot.tool_position)
    far = np.linalg.norm(away)
    aside = far >= _GRIPPER_M and abs(away[2]) < 0.5 * far
    turn, _ = nearest_turn(rotation, away if aside else np.array([0.0, 0.0, np.sign(away[2]) or 1.0]))
    if any(turn):
        content = {**content, "tool": {**content["tool"], "rotation_rpy_degrees": list(turn)}}
    file = convert(content, RobotFile)
    robot = read_fields(file, out, packages=packages).robot
    for mounted, joints in _postures(robot):
        degrees = np.where(robot.prismatic, joints, np.degrees(joints)).round(3)
        rounded = np.where(robot.prismatic, degrees, np.radians(degrees))
        at = dataclasses.replace(mounted, home=jnp.asarray(rounded), stow=jnp.asarray(rounded))
        pose = {"home_degrees": degrees.tolist(), "stow_degrees": degrees.tolist()}
        pose["mount"] = {"position": np.asarray(mounted.mount_position).tolist()}
        if not set_up_faults(convert({**content, **pose}, RobotFile), at) and not _over_tables(at):
            return {**content, **pose}
    raise field_error("model", "no posture with the tool down over a deck", "is an arm with one (or another --tool)")


def _over_tables(robot: Robot) -> bool:
    try:
        check_tables(robot, _TABLE_M)
    except DocumentError:
        return True
    return False


def _postures(robot: Robot) -> Iterator[tuple[Robot, Float[np.ndarray, " dof"]]]:
    """Mounted robots and joints that bring the fingers over the deck, pointing down; those far from limits first."""
    lower, upper = np.asarray(robot.joint_lower), np.asarray(robot.joint_upper)
    seeds = np.random.default_rng(0).uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (_SEEDS, robot.dof))
    yaw = np.arange(_YAWS) * (2 * np.pi / _YAWS)
    cosine, sine, zero = np.cos(yaw), np.sin(yaw), 0.0 * yaw
    down = np.stack([np.stack([cosine, sine, zero], -1), np.stack([sine, -cosine, zero], -1)], -1)
    down = np.concatenate([down, np.broadcast_to([[0.0], [0.0], [-1.0]], (_YAWS, 3, 1))], axis=-1)
    solve = jax.jit(solve_ik)
    top = float(robot.body_center[2] + robot.body_half_size[2])
    for above, (height, place) in itertools.product(_ABOVE_M, _MOUNTS):
        mounted = dataclasses.replace(robot, mount_position=np.array([*place, height]))
        target = np.array([*np.asarray(robot.deck)[:2], top + above + GRASP_DEPTH_M]) - np.array([*place, height])
        solution = solve(
            mounted,
            jnp.asarray(target, jnp.float32)[None, None],
            jnp.asarray(down, jnp.float32)[:, None],
            jnp.asarray(seeds, jnp.float32)[None],
        )
        joints = np.asarray(solution.joints, float)[np.asarray(solution.converged)]
        margin = np.minimum(joints - lower, upper - joints).min(axis=-1)
        yield from ((mounted, each) for each in joints[np.argsort(-margin)][:200])


def _commented(content: dict[str, Any], chain: Chain, joints: Mapping[str, ModelJoint]) -> str:
    """The file's text, what isn't read from the model marked."""
    spoken = any(joints.get(name, ModelJoint()).velocity for name in chain.joints)
    notes = {
        "tool": "guessed: the frame's z, turned by rotation_rpy_degrees if there is one, points out of the gripper",
        "grasp_depth": "guessed: from the tool frame to where the fingers meet (m), 0 for a TCP frame",
        "joint_speed": "the model's, else guessed (rad/s)" if spoken else "guessed (rad/s)",
        "joint_acceleration": "guessed (rad/s^2)",
        "home_degrees": "found by search: tool down over the deck",
        "stow_degrees": "likewise",
        "mount": "guessed: where the arm stands on the base (m)",
        "deck": "guessed: where picked objects go",
        "base": "guessed: all of it",
    }
    lines = ["# A first robot file, by python -m basenet_jax.robot init: correct what is guessed."]
    for key, value in content.items():
        own = to_yaml({key: value}).decode().strip()
        own = own[1:-1] if own.startswith("{") else own
        lines += [f"# {notes[key]}"] if key in notes else []
        lines.append(own)
    return "\n".join(lines) + "\n"
