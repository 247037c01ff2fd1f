"""What the session does with wishes, with a planner that costs nothing instead of the real ones."""

import threading
import time

import numpy as np
import pytest

from basenet_jax import api
from basenet_jax.planners import registry
from basenet_jax.planners.protocol import PlanningError
from basenet_jax.viewer import plan_maker, uploads
from basenet_jax.viewer.planned import Awaited, Planned, Refused
from basenet_jax.viewer.session import Choices, Session
from tests.scene_texts import TEXT, park_once
from tests.viewer import WATCHDOG_S


class Screen:
    """Keeps all that it is told."""

    def __init__(self):
        self.scenes, self.new, self.plans, self.answers, self.texts = [], [], [], [], []

    def show_scene(self, scene, *, new):
        self.scenes.append(scene)
        self.new.append(new)

    def show_plans(self, plans):
        self.plans.append(plans)

    def show_answer(self, answer):
        self.answers.append(answer)

    def show_status(self, text):
        self.texts.append(text)


@pytest.fixture
def called():
    """Scenes that were planned."""
    return []


@pytest.fixture
def gate():
    """Planning waits while it is clear."""
    made = threading.Event()
    made.set()
    return made


@pytest.fixture(autouse=True)
def planners(monkeypatch, called, gate):
    """dp refuses every scene; all others park once for all objects."""

    def make(name, setup, options):
        del setup, options

        def plan(scene, key):
            called.append(scene)
            assert gate.wait(WATCHDOG_S)
            if name == "dp":
                raise PlanningError("objects: found 2, dp plans fewer")
            return park_once(scene, key)

        return plan

    monkeypatch.setattr(registry, "make_planner", make)
    api._planner.cache_clear()
    yield
    api._planner.cache_clear()


@pytest.fixture
def screen():
    return Screen()


@pytest.fixture
def session(scene, screen):
    made = Session(scene, Choices(("basenet",)), screen, threading.RLock())
    made.begin()
    assert made.wait_idle(WATCHDOG_S)
    yield made
    assert made.wait_idle(WATCHDOG_S)
    assert made.close()


def move(session, x):
    session.move("mug_1", np.array([x, -0.2, 0.0]))


def test_it_begins_with_a_plan(session, screen, scene):
    (plan,) = session.plans
    assert isinstance(plan, Planned)
    assert (plan.maker, int(plan.outcome.grasped)) == ("basenet", 2)
    assert plan.planning_s is not None
    assert screen.scenes[0].names == scene.names
    assert screen.plans[-1] == session.plans


def test_a_change_is_shown_at_once_and_planned(session, screen, gate):
    gate.clear()
    move(session, -0.1)
    assert screen.scenes[-1].arrays.object_pose[0, 0] == pytest.approx(-0.1)
    shown = len(screen.plans)
    gate.set()
    assert session.wait_idle(WATCHDOG_S)
    assert len(screen.plans) == shown + 1
    assert session.plans[0].scene is session.scene
    assert session.last.shown_s - session.last.asked_s > 0.0


def test_of_another_scene_no_old_plan_is_shown(session, screen, gate):
    """Planning it may take a minute of compiling."""
    gate.clear()
    session.upload_scene("scene.yaml", TEXT.encode())
    assert (screen.new[-1], screen.plans[-1], session.plans) == (True, (Awaited("basenet"),), (Awaited("basenet"),))
    gate.set()
    assert session.wait_idle(WATCHDOG_S)
    assert isinstance(session.plans[0], Planned)
    gate.clear()
    move(session, -0.1)
    assert not screen.new[-1]
    assert isinstance(session.plans[0], Planned), "of what has hardly changed it stays until there is a new one"
    session.choose("mbp")
    assert session.plans == (Awaited("mbp"),)
    gate.set()


def test_a_refused_change_changes_nothing(session, screen, called):
    scene, count = session.scene, len(called)
    with pytest.raises(ValueError, match="mug_2 does"):
        session.move("mug_1", scene.arrays.object_pose[1])
    assert session.wait_idle(WATCHDOG_S)
    assert session.scene is scene
    assert len(called) == count


def test_changes_dont_queue_up(session, called, gate):
    count = len(called)
    gate.clear()
    for x in np.linspace(-0.5, 0.1, 40):
        move(session, x)
    gate.set()
    assert session.wait_idle(WATCHDOG_S)
    assert count < len(called) <= count + 2, "the first, while the others came, and the last"
    assert session.plans[0].scene is session.scene
    assert session.scene.arrays.object_pose[0, 0] == pytest.approx(0.1)


def test_two_planners_side_by_side_of_which_one_refuses(session):
    session.choose("greedy-stops", "dp")
    assert session.wait_idle(WATCHDOG_S)
    first, second = session.plans
    assert isinstance(first, Planned)
    assert second == Refused("dp", "objects: found 2, dp plans fewer")
    move(session, -0.3)
    assert session.wait_idle(WATCHDOG_S)
    assert [plan.maker for plan in session.plans] == ["greedy-stops", "dp"]


def test_the_second_planner_is_awaited_and_left_out_while_the_scene_changes(session, screen, called, gate):
    session.choose("mbp", "pbg")
    assert session.wait_idle(WATCHDOG_S)
    shown, count = len(screen.plans), len(called)
    gate.clear()
    move(session, -0.3)
    while len(called) == count:  # until it has begun
        time.sleep(0.01)
    move(session, -0.4)
    gate.set()
    assert session.wait_idle(WATCHDOG_S)
    whole = [[type(plan) for plan in plans] for plans in screen.plans[shown:]]
    assert whole == [[Planned, Awaited], [Planned, Awaited], [Planned, Planned]]
    assert all(plans[1].keep for plans in screen.plans[shown:-1])


def test_an_unknown_planner_is_refused(session):
    with pytest.raises(ValueError, match="found 'best', allowed are pbg"):
        session.choose("best")
    move(session, -0.3)
    assert session.wait_idle(WATCHDOG_S)
    assert [plan.maker for plan in session.plans] == ["basenet"]


def test_objects_come_and_go(session):
    assert session.add_object("mug") == "mug_3"
    session.remove("mug_1")
    assert session.wait_idle(WATCHDOG_S)
    assert session.scene.names == ("mug_2", "mug_3")
    assert session.plans[0].scene is session.scene


def test_a_plan_file_is_shown_until_something_changes(session):
    session.upload_plan("mine.json", uploads.plan_file(session.plans[0]))
    assert session.wait_idle(WATCHDOG_S)
    (plan,) = session.plans
    assert (plan.maker, plan.planning_s, int(plan.outcome.grasped)) == ("mine.json", None, 2)
    move(session, -0.3)
    assert session.wait_idle(WATCHDOG_S)
    assert session.plans[0].maker == "basenet"


def test_a_bad_file_changes_nothing(session):
    scene, plans = session.scene, session.plans
    with pytest.raises(ValueError, match=r"scene\.yaml: content: found an empty file"):
        session.upload_scene("scene.yaml", b"")
    with pytest.raises(ValueError, match=r"plan\.json: .*JSON"):
        session.upload_plan("plan.json", b"{")
    assert (session.scene, session.plans) == (scene, plans)


def test_a_scene_file_replaces_the_scene(session):
    session.upload_scene("scene.yaml", TEXT.encode())
    assert session.wait_idle(WATCHDOG_S)
    assert session.scene.names == ("mug_1", "part_7")
    assert session.plans[0].scene is session.scene


def test_a_question_is_answered_anew_after_every_change(session, screen):
    session.ask((0.35, -0.9))
    assert session.wait_idle(WATCHDOG_S)
    assert screen.answers[-1].count == 2
    session.move("mug_1", np.array([-0.9, 0.3, 0.0]))
    assert session.wait_idle(WATCHDOG_S)
    assert screen.answers[-1].count == 1
    session.ask(None)
    move(session, 0.0)
    assert session.wait_idle(WATCHDOG_S)
    assert screen.answers[-1] is None


def test_what_takes_long_is_told(session, screen, gate, monkeypatch):
    monkeypatch.setattr(plan_maker, "_PATIENCE_S", 0.01)
    gate.clear()
    session.choose("mbp")
    told = threading.Event()
    while not any("compiling mbp" in text for text in screen.texts):
        assert not told.wait(0.01)
    gate.set()
    assert session.wait_idle(WATCHDOG_S)
    assert screen.texts[-1] == ""


def test_a_planner_is_also_warmed_up_for_objects_out_of_reach(session, called):
    heights = [float(scene.object_grasps.pose[0, 0, 2]) for scene in called]
    assert max(heights) > 5.0
    move(session, -0.3)
    assert session.wait_idle(WATCHDOG_S)
    assert max(float(scene.object_grasps.pose[0, 0, 2]) for scene in called[len(heights) :]) < 1.0, "once is enough"


def test_an_unforeseen_error_leaves_it_running(session, screen, monkeypatch, capsys):
    monkeypatch.setattr(plan_maker.planned, "make_plan", lambda *_: 1 / 0)
    move(session, -0.3)
    assert session.wait_idle(WATCHDOG_S)
    assert "ZeroDivisionError" in screen.texts[-1]
    assert "ZeroDivisionError" in capsys.readouterr().err
    monkeypatch.undo()
    session.choose("basenet")
    move(session, -0.2)
    assert session.wait_idle(WATCHDOG_S)
