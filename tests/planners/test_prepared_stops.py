"""Stops and drives of a room are made once, kept, and made anew where what is kept is of no use."""

import dataclasses
from typing import Any

import jax
import numpy as np
import pytest

from basenet_jax.config import AlignedConfig, DockedConfig, NavigationConfig, PickConfig
from basenet_jax.planners import prepared_stops as module
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.candidates import grid_poses
from basenet_jax.planners.prepared_stops import forget, prepared_stops
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.task.prepared_world import prepare_world
from basenet_jax.world.boxes import Boxes, Room

FEW = AlignedConfig(step_m=0.8)


@pytest.fixture(scope="module")
def two_tables():
    """A room of two tables and a pillar."""
    rows = np.array([(0.0, 0.0, 0.0, 0.6, 0.3), (3.0, 1.0, 0.4, 0.5, 0.3), (1.5, -0.5, 0.0, 0.1, 0.1)], np.float32)
    zero = np.zeros(3, np.float32)
    there = zero == 0
    bears = np.array([True, True, False])
    leaves: tuple[Any, ...] = (rows[:, :3], rows[:, 3:], zero, zero + 0.75, there, there, bears)
    floor: Any = np.array([-3.0, -3.0, 6.0, 4.0], np.float32)
    return Room(Boxes(*leaves), floor)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty cache folder, and nothing in memory."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    yield tmp_path / "basenet_jax" / "rooms"
    forget()


@pytest.fixture
def made(monkeypatch):
    """How often a world was prepared."""
    calls = []

    def count(*given):
        calls.append(given)
        return prepare_world(*given)

    monkeypatch.setattr(module, "prepare_world", count)
    return calls


def ask(robot, room, **changes):
    """The stops, as a process that begins anew gets them."""
    forget()
    return prepared_stops(robot, room, **{"aligned": FEW, **changes})


def test_what_is_kept_is_what_was_made(robot, two_tables, folder, made):
    first, again = ask(robot, two_tables), ask(robot, two_tables)
    assert len(made) == 1
    assert jax.tree.structure(first) == jax.tree.structure(again)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert len(first.poses) > 20
    assert np.isfinite(first.drive).mean() > 0.9
    assert len(list(folder.iterdir())) == 1


def test_drives_of_what_is_kept_go_on_from_anywhere(robot, two_tables, folder):
    ask(robot, two_tables)
    prepared = ask(robot, two_tables)
    row = prepared.first_drives(robot, prepared.poses[:1])[0]
    np.testing.assert_allclose(row, prepared.drive[0], atol=6e-3)  # float32, as in the tests of docked drives


@pytest.mark.parametrize("damage", [lambda whole: whole[:-9], lambda _: b"", lambda whole: whole[:99] + b"!" * 99])
def test_a_damaged_file_is_made_anew(robot, two_tables, folder, made, damage):
    whole = ask(robot, two_tables)
    (file,) = folder.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    jax.tree.map(np.testing.assert_array_equal, ask(robot, two_tables), whole)
    ask(robot, two_tables)
    assert len(made) == 2


def test_whatever_drives_depend_on_is_another_file(robot, two_tables, folder, monkeypatch):
    ask(robot, two_tables)

    def refuse(*_):
        raise LookupError

    monkeypatch.setattr(module, "prepare_world", refuse)
    ask(robot, two_tables)
    for given in (
        {"robot": dataclasses.replace(robot, base_speed=2 * robot.base_speed)},
        {"room": dataclasses.replace(two_tables, floor=2 * two_tables.floor)},
        {"aligned": AlignedConfig(step_m=0.7)},
        {"pick": PickConfig(base_clearance_m=0.12)},
        {"navigation": NavigationConfig(docked=DockedConfig(clearance_m=0.06))},
    ):
        with pytest.raises(LookupError):
            ask(**{"robot": robot, "room": two_tables, **given})
    monkeypatch.setattr(module, "source_digest", lambda: "another")
    with pytest.raises(LookupError):
        ask(robot, two_tables)


def test_a_moved_table_needs_no_other_shapes(robot, two_tables, folder):
    """What is compiled for a room serves it when a table has been moved, which changes what is seen and reached."""
    pose = two_tables.boxes.pose + np.array([(0.13, -0.07, 0.2), (0, 0, 0), (0, 0, 0)], np.float32)
    moved = dataclasses.replace(two_tables, boxes=dataclasses.replace(two_tables.boxes, pose=pose))
    setups = [PlannerSetup(robot=robot, room=room) for room in (two_tables, moved)]
    before, after = (aligned_poses(robot, room, FEW) for room in (two_tables, moved))
    assert len(before) != len(after)
    shapes = [jax.tree.map(np.shape, ask(robot, room)) for room in (two_tables, moved)]
    assert shapes[0] == shapes[1]
    assert setups[0].grid_poses.shape == setups[1].grid_poses.shape
    own = grid_poses(robot, two_tables)
    np.testing.assert_array_equal(setups[0].grid_poses[: len(own)], own)
    assert len(own) < len(setups[0].grid_poses) < 1.5 * len(own) + 1


def test_without_a_folder_memory_alone_keeps(robot, two_tables, tmp_path, monkeypatch, made):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("BASENET_JAX_CACHE", "off")
    first = ask(robot, two_tables)
    assert prepared_stops(robot, two_tables, FEW) is first
    assert len(made) == 1
    assert not list(tmp_path.iterdir())


def test_drives_of_a_point_are_not_written(robot, room, folder, made):
    ask(robot, room)
    assert len(made) == 1
    assert not folder.exists()
