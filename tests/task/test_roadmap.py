"""Roadmaps against brute force, and what they are made of."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.task import road_search
from basenet_jax.task import roadmap as module
from basenet_jax.task.docked_drives import compiled_gates, drive_times
from basenet_jax.task.roadmap import BLOCK, make_roadmap, padded
from tests.oracles import docked_drives as oracle
from tests.task import docked_rooms
from tests.task.docked_rooms import base_of, draw_room, room_of


@pytest.fixture(scope="module")
def room():
    return draw_room(np.random.default_rng(12), 6)


def test_vias_see_each_other_as_brute_force_says(robot, room):
    base, roadmap = base_of(robot), make_roadmap(robot, room_of(room))
    vias = sorted(set(np.round(oracle.vias(base, room), 4).ravel().view(complex).tolist()), key=abs)
    ours = roadmap.via[roadmap.is_via]
    np.testing.assert_allclose(sorted((complex(*via) for via in ours), key=abs), vias, atol=2e-4)
    for via, neighbours, time in zip(ours, roadmap.neighbour, roadmap.time, strict=False):
        seen = {int(n) for n in neighbours[np.isfinite(time)]}
        others = [n for n, other in enumerate(ours) if np.hypot(*(other - via)) > 1e-3]
        assert seen == {n for n in others if oracle.piece_free(base, room, tuple(via), tuple(ours[n]))}
    assert 0 < np.isfinite(roadmap.time).sum() < len(ours) * (len(ours) - 1), "says little"


def test_times_of_pieces_and_turns(robot, room):
    base, roadmap = base_of(robot), make_roadmap(robot, room_of(room))
    pieces = np.argwhere(np.isfinite(roadmap.time))
    for via, here in pieces[::3]:
        place, there = roadmap.via[via], roadmap.via[roadmap.neighbour[via, here]]
        assert roadmap.time[via, here] == pytest.approx(base.straight(np.hypot(*(there - place))), abs=1e-4)
        back = np.unravel_index(roadmap.back[via, here], roadmap.back.shape)
        assert (back[0], roadmap.neighbour[back]) == (roadmap.neighbour[via, here], via)
        for onward in np.flatnonzero(np.isfinite(roadmap.time[via])):
            after = roadmap.via[roadmap.neighbour[via, onward]]
            angle = np.subtract(*(np.arctan2(*(b - a)[::-1]) for a, b in ((place, after), (there, place))))
            assert roadmap.turn[via, here, onward] == pytest.approx(base.turn(angle), abs=6e-3)


def test_rows_of_large_rooms_hold_all_pieces_and_few_others(robot, room, monkeypatch):
    whole = make_roadmap(robot, room_of(room))
    monkeypatch.setattr(module, "_SMALL", 0)
    roadmap = make_roadmap(robot, room_of(room))
    np.testing.assert_array_equal(whole.rows, np.arange(whole.time.size))
    size, rows = roadmap.time.size, roadmap.rows[roadmap.rows < roadmap.time.size]
    assert set(np.flatnonzero(np.isfinite(roadmap.time))) <= set(rows.tolist())
    degree = np.isfinite(roadmap.time).sum(axis=1)
    assert len(rows) == np.sum(-(-degree // BLOCK) * BLOCK) < size
    assert np.all(roadmap.rows[len(rows) :] == size)


@pytest.mark.parametrize("small", [0, 4096], ids=["in rows", "whole lists"])
def test_drives_are_the_same_block_by_block(robot, room, monkeypatch, small):
    poses = docked_rooms.draw_poses(np.random.default_rng(0), base_of(robot), room)
    expected = docked_rooms.drives(robot, room, poses, poses)
    monkeypatch.setattr(module, "_SMALL", small)
    monkeypatch.setattr(road_search, "_FEW_SUMS", 0)
    roadmap = make_roadmap(robot, room_of(room))
    ends = compiled_gates(robot, roadmap, poses)
    found = jax.jit(lambda roadmap, ends: drive_times(robot, roadmap, ends, ends))(roadmap, ends)
    assert np.any(np.isfinite(expected) & (expected > 0))
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_base_that_drives_sideways_turns_at_no_via(robot, room):
    assert not np.any(make_roadmap(docked_rooms.sideways(robot), room_of(room)).turn)


def test_what_the_base_passes_under_is_no_obstacle(robot):
    room = room_of(oracle.Room(((0.0, 0.0, 0.0, 1.0, 0.4),)))
    boxes = dataclasses.replace(room.boxes, low=np.array([0.76]), high=np.array([0.8]))
    high = dataclasses.replace(room, boxes=boxes)
    assert make_roadmap(robot, room).is_via.sum() == 4
    assert make_roadmap(robot, high).is_via.sum() == 0


@pytest.mark.parametrize(("count", "size"), [(0, 24), (24, 24), (25, 32), (33, 48), (49, 64), (65, 96), (400, 512)])
def test_sizes_are_few(count, size):
    assert padded(count) == size
