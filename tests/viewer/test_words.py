"""What the page says; and that a name is never taken for anything else."""

import dataclasses

import numpy as np
import pytest

from basenet_jax.task.motion import Doing
from basenet_jax.task.picking import Reason
from basenet_jax.viewer import words
from basenet_jax.viewer.asking import Answer
from basenet_jax.viewer.planned import Refused
from tests import judged

HOSTILE = "<img src=x onerror=alert(1)>{alert(1)}"


@pytest.fixture
def failing(planned):
    """The second object isn't grasped, and has a name that a page might run."""
    scene = dataclasses.replace(planned.scene, names=("mug_1", HOSTILE))
    return dataclasses.replace(planned, scene=scene, outcome=judged.with_failure(planned.outcome, 1))


def test_figures_of_two_plans_stand_side_by_side(planned):
    text = words.figures([planned, Refused("dp", "objects: found 20")], ["#111111", "#222222"])
    assert f"{float(planned.outcome.navigation):.1f} s" in text
    assert f"{float(planned.outcome.execution):.1f} s" in text
    assert "2 of 2" in text
    assert "2 ms" in text
    assert "dp: objects: found 20" in text


def test_what_isnt_grasped_is_named_with_the_reason(failing):
    assert words.failures(failing) == [(HOSTILE, "out of the arm's reach")]
    text = words.figures([failing], ["#111111"])
    assert "1 of 2" in text
    assert "&lt;img src=x onerror=alert(1)&gt;{alert(1)}: out of the arm&#x27;s reach" in text
    assert words.labels(failing) == {"mug_1": "1", HOSTILE: "not grasped"}


def test_no_name_becomes_markup(failing):
    answer = Answer(np.zeros(3), (HOSTILE,), (None,), (Reason.OUT_OF_REACH,))
    refused = Refused(HOSTILE, HOSTILE)
    texts = (words.figures([failing, refused], ["#111111"] * 2), words.answer(answer), words.paragraph(HOSTILE))
    assert not any("<img" in text for text in texts)


def test_an_answer_has_a_time_or_a_reason_for_each_object():
    pose = np.array([0.5, -0.9, np.pi / 2])
    answer = Answer(pose, ("mug_1", "bowl_1"), (9.87, None), (Reason.NONE, Reason.ARM_COLLIDES))
    text = words.answer(answer)
    assert "(0.50, -0.90) m, heading 90°" in text
    assert "1 of 2 objects" in text
    assert "9.9 s" in text
    assert words.REASONS[Reason.ARM_COLLIDES] in text


def test_where_the_base_collides_that_is_all_there_is_to_say():
    answer = Answer(np.zeros(3), ("mug_1",), (None,), (Reason.BASE_COLLIDES,), at_base=("the table",))
    assert "the base would touch the table or its margin" in words.answer(answer)
    assert "mug_1" not in words.answer(answer)


def test_in_rooms_boxes_are_named():
    """And no name becomes markup."""
    collides = Answer(np.zeros(3), ("mug_1",), (None,), (Reason.BASE_COLLIDES,), at_base=("bench", HOSTILE))
    assert "touch bench or &lt;img" in words.answer(collides)
    beyond = Answer(np.zeros(3), ("mug_1",), (None,), (Reason.BASE_COLLIDES,), on_floor=False)
    assert "the base would leave the floor" in words.answer(beyond)
    lamps = {"mug_1": ("lamp", HOSTILE)}
    touched = Answer(np.zeros(3), ("mug_1",), (None,), (Reason.ARM_COLLIDES,), in_the_way=lamps, way=False)
    assert "the arm would touch lamp or &lt;img" in words.answer(touched)
    assert "no way for the base to get there" in words.answer(touched)


def test_where_nothing_can_be_picked_no_heading_is_called_the_best():
    answer = Answer(np.array([3.0, 3.0, 0.5]), ("mug_1",), (None,), (Reason.OUT_OF_REACH,))
    text = words.answer(answer)
    assert "heading 29°" not in text
    assert "nothing, at any heading tried" in text
    assert words.REASONS[Reason.OUT_OF_REACH] in text


def test_what_the_robot_does_is_said(planned):
    time = planned.motion.time
    said = [words.doing(planned, moment) for moment in (time[:-1] + time[1:]) / 2]
    assert said[0] == "to mug_1: turn"
    assert [each for each in said if "drive" in each]
    assert [each for each in said if "close gripper" in each] == ["mug_1: close gripper", "mug_2: close gripper"]
    assert words.doing(planned, float(time[-1]) + 1.0) == ""


@pytest.mark.parametrize(
    ("after", "text"), [((1.0, 1.0), "drive"), ((-1.0, -1.0), "drive in reverse"), ((-1.0, 1.0), "drive sideways")]
)
def test_which_way_it_drives_is_said(planned, after, text):
    """Heading for the corner between x and y."""
    poses = np.array([(0.0, 0.0, np.pi / 4), (*after, np.pi / 4)])
    motion = planned.motion
    part = next(each for each in motion.parts if each.doing == Doing.DRIVE)
    drive = motion._replace(time=np.array([0.0, 2.0]), base_pose=poses, parts=(part,))
    assert words.doing(dataclasses.replace(planned, motion=drive), 1.0) == f"to mug_1: {text}"


def test_every_reason_has_words():
    assert set(words.REASONS) == set(Reason) - {Reason.NONE}


@pytest.mark.parametrize(("seconds", "text"), [(0.0023, "2 ms"), (0.4, "400 ms"), (1.26, "1.3 s")])
def test_durations(seconds, text):
    assert words.duration(seconds) == text
