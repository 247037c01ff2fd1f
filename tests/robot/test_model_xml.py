"""Models that would take the machine, and texts that are no model: refused in a line, whatever is in them."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import mujoco
import pytest

from basenet_jax.robot.reading import RobotFileError, read_robot, read_source
from tests.robot import mini


def refused(path, *messages):
    with pytest.raises(RobotFileError) as caught:
        read_robot(path)
    for message in messages:
        assert message in str(caught.value)
    assert len(str(caught.value)) < 1000


def chain(count, below=lambda index: f"x{index - 1}"):
    links = "".join(f'<link name="x{i}"/>' for i in range(count))
    joints = "".join(
        f'<joint name="y{i}" type="fixed"><parent link="{below(i)}"/><child link="x{i}"/></joint>'
        for i in range(1, count)
    )
    return links + joints + '<joint name="y0" type="fixed"><parent link="tool0"/><child link="x0"/></joint>'


HUGE = {
    "a long chain": (mini.urdf(chain(900)), "model: found a chain of 907 links, allowed are up to 128"),
    "many links": (
        mini.urdf(chain(1500, below=lambda _: "tool0")),
        "mini.urdf: found 1508 elements <link>, allowed are 1000",
    ),
    "many elements": (mini.urdf("<x/>" * 30_000), "mini.urdf: found more than 20000 elements"),
    "many boxes": (
        mini.urdf(l2='<collision><geometry><box size="1 1 1"/></geometry></collision>' * 4500),
        "mini.urdf: found 4506 elements <collision>, allowed are 4000",
    ),
    "many boxes on the arm": (
        mini.urdf(l2='<collision><geometry><box size="1 1 1"/></geometry></collision>' * 400),
        "model: found 405 shapes on the arm, allowed are up to 300 (or give its shape as capsules in the robot file)",
    ),
    "deep": (mini.urdf("<x>" * 5000 + "</x>" * 5000), "mini.urdf: found more than 128 levels of elements"),
    "large": (mini.urdf(" " * (4 << 20)), "mini.urdf: found more than 4194304 bytes, allowed are up to"),
}


@pytest.mark.parametrize("what", HUGE)
def test_huge_models(tmp_path, what):
    model, message = HUGE[what]
    refused(mini.write(tmp_path, model), message)


def including(folder, count, body):
    """A model that includes a file, which includes one, and so on."""
    for index in range(count):
        more = f'<include file="i{index + 1}.xml"/>' if index + 1 < count else ""
        (folder / f"i{index}.xml").write_text(f"<x>{body.replace('HERE', more)}</x>")
    return '<mujoco><worldbody><include file="i0.xml"/></worldbody></mujoco>'


def test_includes_that_are_deep_or_large_together(tmp_path):
    deep = including(tmp_path, 20, "<body>" * 100 + "HERE" + "</body>" * 100)
    refused(mini.write(tmp_path, deep), "found more than 128 levels of elements, allowed are up to these")
    large = including(tmp_path, 3, " " * (3 << 20) + "HERE")
    refused(mini.write(tmp_path, large), "found more than 8388608 bytes with what is included, allowed are up to")
    (tmp_path / "big.xml").write_text(f"<x>{'<body/>' * 1000}</x>")
    often = "<mujoco><worldbody>" + '<include file="big.xml"/>' * 60 + "</worldbody></mujoco>"
    refused(mini.write(tmp_path, often), "big.xml: found more than 20000 elements")


def test_what_mujoco_makes_itself_is_no_traceback(tmp_path):
    asset = '<asset><mesh name="m" builtin="sphere" params="2000"/></asset>'
    refused(mini.write(tmp_path, f"<mujoco>{asset}<worldbody/></mujoco>"), "robot.yaml: ")


XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
TEXTS = {
    "xacro": (
        f'<robot name="x" {XACRO}><xacro:include filename="a.xacro"/></robot>',
        "found xacro, allowed is plain URDF",
    ),
    "xacro's names": (
        '<robot name="x"><link name="${prefix}base_link"/></robot>',
        "expand it first (xacro mini.urdf > a",
    ),
    "xacro without its space": (
        '<robot name="x"><xacro:arm prefix=""/></robot>',
        "found xacro, allowed is plain URDF: ex",
    ),
    "a comment first": (
        "<!-- by an exporter -->\n" + mini.urdf(),
        "no XML: XML or text declaration not at start of entit",
    ),
    "a pointer": (
        "version https://git-lfs.github.com/spec/v1\n",
        "mini.urdf: found a git-lfs pointer in place of the fil",
    ),
    "two links of one name": (mini.urdf('<link name="l3"/>'), "model: found the link 'l3' twice, allowed is once"),
}


@pytest.mark.parametrize("what", TEXTS)
def test_texts_that_are_no_model_yet(tmp_path, what):
    model, message = TEXTS[what]
    refused(mini.write(tmp_path, model), message)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_other_encodings_are_read(tmp_path, encoding):
    path = mini.write(tmp_path)
    text = mini.urdf().replace('version="1.0"', f'version="1.0" encoding="{encoding[:6].rstrip("-")}"')
    (tmp_path / "mini.urdf").write_bytes(text.encode(encoding))
    assert read_robot(path).name == "mini"


def test_what_is_accepted_compiles(tmp_path):
    """A last link without a shape, and hence without a mass."""
    robot = read_source(mini.write(tmp_path, mini.urdf(l5="", l6=""))).robot
    model = mujoco.MjModel.from_xml_string(robot.model_xml)
    assert model.nv == 9
