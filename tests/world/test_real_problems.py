"""A UR5 among shelves, boxes and tables: MotionBenchMaker's problems, both ends of which are free by FCL with meshes.

The robot stands still: a UR5 on a stand, mounted 0.9144 m over the floor, with a sensor and a Robotiq gripper. It is
described here by Universal Robots' lengths, as capsules about as thick as its links; the gripper's ends 0.04 m before
the fingertips, which are round an object at a grasp. Of the obstacles all boxes are boxes but the lid of `box_ur5`,
which is tilted by 45 degrees and left out: boxes here turn about z alone. Cylinders all stand upright: boxes about them
stand for them. There are no spheres.

The goals of `table_pick_ur5` are left out. Its hundred scenes are one and the same, with a table on one side, while the
goals are all round the robot, and the middle of the arm is inside a box in eight of them.
"""

import functools
import itertools
import tarfile
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest
import yaml

from basenet_jax.robot.reading import load_robot
from basenet_jax.robot.self_contact import hits_itself
from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room
from basenet_jax.world.mujoco_scene import MujocoChecker
from tests import compiled
from tests.shared_data import shared_file

SCENARIOS = (
    "bookshelf_small_ur5",
    "bookshelf_tall_ur5",
    "bookshelf_thin_ur5",
    "box_ur5",
    "cage_ur5",
    "table_pick_ur5",
    "table_under_pick_ur5",
)
STRANGE = "table_pick_ur5"
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
D, A = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823), (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)  # m: a UR5's
ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
MOUNT_M, TURN = 0.9144, 1.57 + np.pi  # of the arm; a joint at 0 points the other way than in the problems' model
BASE = np.array([0.0, 0.0, TURN])
SHOULDER_M, FOREARM_M, FINGERS_M = 0.13585, 0.01615, 0.12  # beside the first joint's plane, and beyond tool0
MOST_BOXES = 24
ROUNDING = 2e-6  # m, as in the tests of contacts
_hits_itself = jax.jit(hits_itself)

MODEL = """
<mujoco model="ur5">
  <compiler angle="radian"/>
  <default><geom type="capsule" size="0.045"/><joint axis="0 0 1" limited="true" range="-6.2832 6.2832"/></default>
  <worldbody><body name="arm_base">
    <body pos="0 0 0.089159"><joint name="shoulder_pan"/>
      <body euler="1.5707963267948966 0 0"><joint name="shoulder_lift"/>
        <geom size="0.055" fromto="0 0 0 0 0 0.13585"/>
        <geom size="0.055" fromto="0 0 0.13585 -0.425 0 0.13585"/>
        <body pos="-0.425 0 0"><joint name="elbow" range="-3.1416 3.1416"/>
          <geom fromto="0 0 0.13585 0 0 0.01615"/>
          <geom fromto="0 0 0.01615 -0.39225 0 0.01615"/>
          <body pos="-0.39225 0 0"><joint name="wrist_1"/>
            <geom size="0.04" fromto="0 0 0.01615 0 0 0.10915"/>
            <body pos="0 0 0.10915" euler="1.5707963267948966 0 0"><joint name="wrist_2"/>
              <geom size="0.04" fromto="0 0 0 0 0 0.09465"/>
              <body pos="0 0 0.09465" euler="-1.5707963267948966 0 0"><joint name="wrist_3"/>
                <geom size="0.035" fromto="0 0 0 0 0 0.0823"/>
                <site name="tool0" pos="0 0 0.0823"/>
                <geom size="0.04" fromto="0 0 0.0823 0 0 0.2023"/>
  </body></body></body></body></body></body></body></worldbody>
</mujoco>
"""


class Problem(NamedTuple):
    """One of a scenario."""

    name: str
    ends: np.ndarray  # 2 x 6, joints at start and goal (rad)
    boxes: np.ndarray  # n x 7: x, y, yaw, half sizes, low, high (m, rad)


@pytest.fixture(scope="module")
def ur5(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ur5")
    (folder / "ur5.xml").write_text(MODEL)
    limits = {"joint_speed": [1.0] * 6, "joint_acceleration": [1.4] * 6}
    stand = {"center": [0.0, 0.0, 0.35], "size": [0.2, 0.2, 0.7]}
    base = {"footprint": [1.3, 1.3], "body": stand, "speed": {"linear": 0.5, "angular": 0.5}}
    robot = {
        "format": "basenet-robot/1",
        "name": "ur5_on_a_stand",
        "model": "ur5.xml",
        "frames": {"arm_base": "arm_base", "tool": "tool0"},
        "joints": JOINTS,
        **limits,
        "home_degrees": [0, -90, 90, -90, -90, 0],
        "stow_degrees": [0, -90, 90, -90, -90, 0],
        "mount": {"position": [0.0, 0.0, MOUNT_M]},
        "deck": {"center": [-0.4, 0.0], "size": [0.5, 0.5]},
        "base": base | {"acceleration": {"linear": 0.5, "angular": 1.0}},
    }
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    return load_robot(str(folder / "robot.yaml"))


def read_boxes(content, *, tilted):
    """The upright primitives of a scene; so many others it has."""
    rows = []
    for item in content["world"]["collision_objects"]:
        for shape, pose in zip(item["primitives"], item["primitive_poses"], strict=True):
            x, y, z, w = np.array(pose["orientation"]) / np.linalg.norm(pose["orientation"])
            if 1.0 - 2.0 * (x * x + y * y) < 0.9999:
                tilted -= 1
                continue
            size = shape["dimensions"]
            if shape["type"] == "cylinder":  # height and radius
                size = [2.0 * size[1], 2.0 * size[1], size[0]]
            else:
                assert shape["type"] == "box"
            yaw, middle = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), pose["position"]
            ends = middle[2] + np.array([-0.5, 0.5]) * size[2]
            rows.append([*middle[:2], yaw, *np.array(size[:2]) / 2, *ends])
    assert tilted == 0
    return np.array(rows)


def read_problems(numbers):
    """These of each scenario."""
    found = []
    with tarfile.open(shared_file("motionbenchmaker/ur5_problems.tar.bz2")) as file:
        content = {member.name: extracted(file, member) for member in file if wanted(member.name, numbers)}
    for scenario in SCENARIOS:
        for number in numbers:
            scene, request = (
                yaml.load(content[f"problems/{scenario}/{kind}{number:04d}.yaml"], yaml.CSafeLoader)
                for kind in ("scene", "request")
            )
            start, (goal,) = request["start_state"]["joint_state"], request["goal_constraints"]
            ends = [
                dict(zip(start["name"], start["position"], strict=True)),
                {each["joint_name"]: each["position"] for each in goal["joint_constraints"]},
            ]
            joints = np.array([[end[f"{name}_joint"] for name in JOINTS] for end in ends])
            boxes = read_boxes(scene, tilted=int(scenario == "box_ur5"))
            found.append(Problem(f"{scenario} {number}", joints, boxes))
    return found


def extracted(file, member):
    stream = file.extractfile(member)
    assert stream is not None
    return stream.read()


def wanted(name, numbers):
    return name.endswith(".yaml") and int(name[-9:-5]) in numbers


def room_of(boxes):
    """Boxes that block the arm alone, and others that aren't there."""
    rows = np.zeros((MOST_BOXES, 7), np.float32)
    rows[: len(boxes)] = boxes
    there, nothing = np.arange(MOST_BOXES) < len(boxes), np.zeros(MOST_BOXES, bool)
    leaves: Any = (rows[:, :3], rows[:, 3:5], rows[:, 5], rows[:, 6], nothing, there, nothing)
    floor: Any = np.array(UNBOUNDED, np.float32)
    return Room(Boxes(*leaves), floor)


class Verdicts(NamedTuple):
    """Of S states in each of P problems."""

    touches: np.ndarray  # whether the arm touches boxes or its stand, by the kernels
    hits_itself: np.ndarray
    depth: np.ndarray  # "P S 2", MuJoCo's distances for the same two (m)


def judge(robot, problems, joints):
    """States "P S 6" of the arm by the kernels, and by MuJoCo."""
    joints = joints.astype(np.float32)
    rooms, count = [room_of(problem.boxes) for problem in problems], joints.shape[1]
    each = jax.tree.map(lambda *x: np.repeat(np.stack(x), count, axis=0), *rooms)
    base, flat = np.tile(BASE, (len(rooms) * count, 1)).astype(np.float32), joints.reshape(-1, 6)
    touches = compiled.arm_collides(robot, base, flat, each)
    call = functools.partial(_hits_itself, jax.device_get(robot))
    itself = compiled.by_rows(lambda rows: call(rows.T), flat)
    rules = compiled.draw_scene(0, 1, Room.from_config())  # so that the arm itself counts; its object is out of the way
    depth = [
        MujocoChecker(robot, room, scene=rules).distances(base[:count], own)[:, [1, 3]]
        for room, own in zip(rooms, joints, strict=True)
    ]
    return Verdicts(touches.reshape(-1, count), itself.reshape(-1, count), np.array(depth))


def check_as_mujoco(found, depth):
    """But for distances that are rounding; what differs is listed by how deep it is."""
    differ = found != (depth <= 0)
    assert np.all(np.abs(depth[differ]) < ROUNDING), np.sort(depth[differ])


def check_ends(robot, problems):
    """They are judged as MuJoCo judges them; returns the distances (boxes, itself) of those that aren't free."""
    verdicts = judge(robot, problems, np.stack([problem.ends for problem in problems]))
    for found, depth in zip(verdicts[:2], np.moveaxis(verdicts.depth, -1, 0), strict=True):
        check_as_mujoco(found, depth)
    taken = np.argwhere(verdicts.touches | verdicts.hits_itself)
    names = {(p, end): f"{problems[p].name}, {('start', 'goal')[end]}" for p, end in taken.tolist()}
    return {
        name: verdicts.depth[place].tolist()
        for place, name in names.items()
        if not (STRANGE in name and "goal" in name)
    }


def skeleton(joints):
    """Points along the lines between the joints' frames and the fingers, in W (m), by 4 x 4 matrices."""
    frame = np.eye(4)
    frame[:2, :2] = [[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]]
    frame[2, 3] = MOUNT_M
    corners = []
    for q, d, a, alpha in zip(joints, D, A, ALPHA, strict=True):
        (c, s), (ca, sa) = (np.cos(q), np.sin(q)), (np.cos(alpha), np.sin(alpha))
        frame = frame @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        corners.append(frame)
    shoulder, elbow = (corners[k][:3, 3] + SHOULDER_M * corners[0][:3, 2] for k in (0, 1))
    forearm, wrist = (corners[k][:3, 3] + FOREARM_M * corners[0][:3, 2] for k in (1, 2))
    tip = corners[5][:3, 3] + FINGERS_M * corners[5][:3, 2]
    chain = [shoulder, elbow, forearm, wrist, corners[3][:3, 3], corners[4][:3, 3], corners[5][:3, 3], tip]
    share = np.linspace(0.0, 1.0, 25)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(chain)])


def inside_a_box(points, boxes):
    """Whether any point is inside any box."""
    away = points[:, None] - np.column_stack([boxes[:, :2], 0.5 * (boxes[:, 5] + boxes[:, 6])])
    sine, cosine = np.sin(boxes[:, 2]), np.cos(boxes[:, 2])
    along, across = cosine * away[..., 0] + sine * away[..., 1], cosine * away[..., 1] - sine * away[..., 0]
    half = np.column_stack([boxes[:, 3:5], 0.5 * (boxes[:, 6] - boxes[:, 5])])
    return bool(np.any(np.all(np.abs(np.stack([along, across, away[..., 2]], axis=-1)) < half, axis=-1)))


@pytest.fixture(scope="module")
def problems():
    return read_problems(range(1, 9))


def test_the_arm_is_the_ur5(ur5, problems):
    """By its Denavit-Hartenberg parameters."""
    joints = np.concatenate([problem.ends for problem in problems])
    position, _ = compiled.forward_kinematics(ur5, joints)
    turned = skeleton_tips(joints)
    np.testing.assert_allclose(position, turned, atol=2e-6)


def skeleton_tips(joints):
    """Where tool0 is in the arm's base frame (m)."""
    tips = []
    for row in joints:
        x, y, z = skeleton(row)[6 * 25 - 1]
        tips.append([np.cos(TURN) * x + np.sin(TURN) * y, np.cos(TURN) * y - np.sin(TURN) * x, z - MOUNT_M])
    return tips


def test_both_ends_are_free(ur5, problems):
    assert check_ends(ur5, problems) == {}


@pytest.mark.slow
def test_both_ends_of_all_problems_are_free(ur5):
    """But three of 1,300, in which capsules are thicker than the links."""
    taken = check_ends(ur5, read_problems(range(1, 101)))
    assert set(taken) == {
        "bookshelf_small_ur5 22, goal",
        "bookshelf_small_ur5 42, goal",
        "bookshelf_tall_ur5 18, goal",
    }
    assert min(min(depth) for depth in taken.values()) > -0.006


def test_the_goals_that_are_left_out_belong_to_other_scenes():
    problems = [each for each in read_problems(range(1, 101)) if STRANGE in each.name]
    assert all(np.array_equal(each.boxes, problems[0].boxes) for each in problems)
    through = [inside_a_box(skeleton(each.ends[1]), each.boxes) for each in problems]
    assert np.sum(through) == 8
    tips = np.array([skeleton(each.ends[1])[-1, :2] for each in problems])
    bearing = np.sort(np.arctan2(tips[:, 1], tips[:, 0]))
    assert np.max(np.diff(bearing)) < np.pi / 2, "all round the robot"


def test_arms_through_boxes_collide(ur5, problems):
    """Whatever an arm's thickness, one whose middle is inside a box touches it.

    MuJoCo finds no contact of a capsule that goes right through a thin box (seen once in 1,792 states, the
    capsule's middle inside the box): of such states the middle is the judge.
    """
    rng = np.random.default_rng(0)
    joints = rng.uniform(-np.pi, np.pi, (len(problems), 32, 6))
    through = np.array(
        [[inside_a_box(skeleton(q), each.boxes) for q in own] for each, own in zip(problems, joints, strict=True)]
    )
    verdicts = judge(ur5, problems, joints)
    assert np.sum(through) > 50
    assert np.all(verdicts.touches[through])
    check_as_mujoco(verdicts.touches[~through], verdicts.depth[~through, 0])
    check_as_mujoco(verdicts.hits_itself, verdicts.depth[..., 1])
    missed = verdicts.depth[through, 0] > 0
    assert np.sum(missed) <= 0.02 * np.sum(through)
    assert np.sum(~verdicts.touches) > 50
    assert np.sum(verdicts.hits_itself) > 20
