"""The stop policy's weights are enough for its planners, alone or with the other layers."""

import jax
import numpy as np
import pytest

from basenet_jax.policies.trained import load_policies, load_stops
from basenet_jax.weights_file import save_weights


@pytest.fixture(scope="module")
def packaged():
    return load_policies()


@pytest.mark.parametrize("alone", [True, False])
def test_the_layer_is_read_from_its_own_file_and_from_that_of_all(packaged, tmp_path, alone):
    save_weights(tmp_path / "some.weights", packaged.stops if alone else packaged, {"robot": "ur5e_mobile"})
    jax.tree.map(np.testing.assert_array_equal, load_stops(tmp_path / "some.weights"), packaged.stops)


def test_by_default_it_is_the_packaged_one(packaged):
    jax.tree.map(np.testing.assert_array_equal, load_stops(), packaged.stops)


def test_another_robots_layer_is_refused(packaged, tmp_path):
    save_weights(tmp_path / "stops.weights", packaged.stops, {"robot": "mine"})
    with pytest.raises(ValueError, match=r"stops\.weights: found weights for the robot 'mine', needed are some for"):
        load_stops(tmp_path / "stops.weights")


def test_another_layers_weights_are_refused(packaged, tmp_path):
    save_weights(tmp_path / "sequence.weights", packaged.sequence, {"robot": "ur5e_mobile"})
    with pytest.raises(ValueError, match=r"sequence\.weights: .*missing"):
        load_stops(tmp_path / "sequence.weights")


def test_base_poses_learned_in_the_tables_frame_are_read_as_such(packaged, tmp_path):
    file, metadata = tmp_path / "basenet.weights", {"robot": "ur5e_mobile"}
    save_weights(file, packaged, metadata | {"base_pose_frame": "table"})
    assert load_policies(file).base_pose.frame == "table"
    save_weights(file, packaged, metadata)
    assert load_policies(file).base_pose.frame == "object"
