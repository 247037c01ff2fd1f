"""A small arm as a URDF, in a folder with its robot file, to be changed in one way each."""

from pathlib import Path

import yaml

ROBOT = {
    "format": "basenet-robot/1",
    "name": "mini",
    "model": "mini.urdf",
    "frames": {"arm_base": "base_link", "tool": "tool0"},
    "joints": ["j1", "j2", "j3", "j4", "j5", "j6"],
    "joint_speed": [1.0] * 6,
    "joint_acceleration": [1.4] * 6,
    "home_degrees": [0, 30, 150, -90, -90, 90],
    "stow_degrees": [0, 30, 150, -90, -90, 90],
    "mount": {"position": [-0.25, -0.15, 1.0]},
    "deck": {"center": [0.15, 0.05], "size": [0.45, 0.35]},
    "base": {
        "footprint": [0.8, 0.5],
        "body": {"center": [0, 0, 0.375], "size": [0.8, 0.5, 0.75]},
        "speed": {"linear": 0.5, "angular": 0.5},
        "acceleration": {"linear": 0.5, "angular": 1.0},
    },
}
# By joint: where its frame is in the link before it, and its axis; a UR's wrist.
JOINTS = {
    "j1": ("0 0 0.16", "0 0 1"),
    "j2": ("0 0.14 0", "0 1 0"),
    "j3": ("0 -0.12 0.42", "0 1 0"),
    "j4": ("0 0 0.39", "0 1 0"),
    "j5": ("0 0.09 0", "0 0 1"),
    "j6": ("0 0 0.09", "0 1 0"),
}
SHAPES = [(0.07, 0.1, 0.0), (0.06, 0.15, 0.0), (0.06, 0.42, 0.21), (0.05, 0.39, 0.195), (0.045, 0.1, 0.0)]
SHAPES += [(0.045, 0.1, 0.0), (0.04, 0.06, 0.0)]
LINKS = ("base_link", "l1", "l2", "l3", "l4", "l5", "l6")
TOOL = (
    '<link name="tool0"/><joint name="jt" type="fixed"><parent link="l6"/><child link="tool0"/>'
    '<origin xyz="0 0.08 0" rpy="-1.5707963267948966 0 0"/></joint>'
)


def shape(link):
    """The collision element of a link: radius, length and height of a cylinder."""
    radius, length, height = SHAPES[LINKS.index(link)]
    geometry = f'<geometry><cylinder radius="{radius}" length="{length}"/></geometry>'
    return f'<collision><origin xyz="0 0 {height}"/>{geometry}</collision>'


def joint(name, kind="revolute", limit='<limit lower="-3.1" upper="3.1" effort="100" velocity="2"/>'):
    """The element of a joint."""
    place, axis = JOINTS[name]
    child = LINKS.index(f"l{name[1]}")
    ends = f'<parent link="{LINKS[child - 1]}"/><child link="{LINKS[child]}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<origin xyz="{place}"/><axis xyz="{axis}"/>{limit}</joint>'


def urdf(more="", tool=TOOL, **changed):
    """The model: elements are replaced by those given by link or joint name, as text."""
    links = "".join(f'<link name="{link}">{changed.get(link, shape(link))}</link>' for link in LINKS)
    joints = "".join(changed.get(name, joint(name)) for name in JOINTS)
    return f'<?xml version="1.0"?><robot name="mini">{links}{joints}{tool}{more}</robot>'


def write(folder: Path, model: str | None = None, **fields) -> Path:
    """Writes model and robot file; fields replace the file's, and those that are None go."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {name: value for name, value in {**ROBOT, **fields}.items() if value is not None}
    (folder / "mini.urdf").write_text(urdf() if model is None else model)
    (folder / "robot.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return folder / "robot.yaml"
