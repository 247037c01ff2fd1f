"""The stop policy's weights are enough for its planners, alone or with the other layers."""

import re

import chex
import jax
import numpy as np
import pytest

from basenet_jax.planners import basenet_paper
from basenet_jax.planners.basenet import BaSeNet
from basenet_jax.planners.basenet_paper import BaSeNetPaper
from basenet_jax.planners.options import LearnedOptions, StopsOptions
from basenet_jax.policies.base_pose import untrained_policy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.networks import BasePoseNetwork, Networks, SequenceNetwork, StopNetwork
from basenet_jax.policies.stop_policy import StopPolicy
from basenet_jax.policies.trained import Weights, load_policies, load_stops, untrained_sequence, untrained_stops
from basenet_jax.weights_file import save_weights
from tests import compiled


@pytest.fixture(scope="module")
def packaged():
    return load_policies()


@pytest.fixture
def setup(robot):
    return compiled.make_setup(robot)


@pytest.mark.parametrize("alone", [True, False])
def test_the_layer_is_read_from_its_own_file_and_from_that_of_all(packaged, tmp_path, alone):
    save_weights(tmp_path / "some.weights", packaged.stops if alone else packaged, {"robot": "ur5e_mobile"})
    jax.tree.map(np.testing.assert_array_equal, load_stops(tmp_path / "some.weights")[1], packaged.stops)


def test_by_default_it_is_the_packaged_one(packaged):
    jax.tree.map(np.testing.assert_array_equal, load_stops()[1], packaged.stops)


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


@pytest.fixture
def small(tmp_path):
    """Weights of networks unlike the presets', in a file that describes them."""
    networks = Networks(
        BasePoseNetwork("table", (12, 7)), SequenceNetwork(6, 2, attention=False), StopNetwork(5, 1, considered=9)
    )
    sequence, stops = networks.sequence.make(), networks.stops.make()

    def make():
        base_pose = untrained_policy((12, 7), "table")
        return Weights(base_pose, untrained_sequence(sequence), untrained_stops(stops), sequence, stops)

    random = np.random.default_rng(0)
    weights = jax.tree.map(lambda x: random.uniform(size=x.shape).astype(np.float32), jax.eval_shape(make))
    file, metadata = tmp_path / "basenet.weights", {"robot": "ur5e_mobile"} | networks.as_metadata()
    save_weights(file, weights, metadata)
    save_weights(tmp_path / "stops.weights", weights.stops, metadata)
    return file, weights, metadata


def test_networks_are_those_that_the_file_describes(small, tmp_path):
    file, weights, _ = small
    chex.assert_trees_all_equal(load_policies(file), weights)
    for path in (file, tmp_path / "stops.weights"):
        policy, params = load_stops(path)
        assert policy == StopPolicy(features=5, layers=1, considered=9)
        chex.assert_trees_all_equal(params, weights.stops)


def test_planners_play_the_networks_that_the_file_describes(small, setup, monkeypatch):
    file, weights, _ = small
    planner = BaSeNet(setup, StopsOptions(weights=file))
    assert planner._program.policy == weights.stop_network
    played = []
    monkeypatch.setattr(basenet_paper, "choose_learned", lambda network, *_: played.append(network))
    monkeypatch.setattr(basenet_paper, "rollout", lambda *_: None)
    monkeypatch.setattr(basenet_paper, "as_plan", lambda _: np.zeros(1))
    scene = compiled.draw_scene(0, 2, setup.room)
    BaSeNetPaper(setup, LearnedOptions(weights=file))(scene, jax.random.key(0))
    assert played == [GraspSequencePolicy(features=6, layers=2, attention=False)]


@pytest.mark.parametrize(
    ("part", "field", "value", "message"),
    [
        ("base_pose", "frame", "floor", r"networks: Invalid enum value 'floor' - at `\$\.base_pose\.frame`"),
        ("base_pose", "hidden", [], r"networks: .*length >= 1 - at `\$\.base_pose\.hidden`"),
        (
            "base_pose",
            "hidden",
            [12, 8],
            r"base_pose/kernels/1: found float32 of shape \(12, 7\), needs float32 of \(12, 8\)",
        ),
        ("sequence", "layers", 0, r"networks: .*>= 1 - at `\$\.sequence\.layers`"),
        ("sequence", "layers", 3, r"sequence/params/Layer_1/.*: missing"),
        ("sequence", "attention", True, r"sequence/params/.*vector: missing"),
        ("stops", "features", 6, r"stops/params/.*: found float32 of shape \(5,\), needs float32 of \(6,\)"),
        ("stops", "colour", 1, r"networks: .*unknown field `colour` - at `\$\.stops`"),
    ],
)
def test_a_description_that_is_not_the_arrays_or_none_at_all_is_refused(small, part, field, value, message):
    file, weights, metadata = small
    metadata["networks"][part][field] = value
    save_weights(file, weights, metadata)
    with pytest.raises(ValueError, match=rf"^{re.escape(str(file))}: {message}"):
        load_policies(file)


def test_a_file_without_a_description_of_other_networks_is_refused(small):
    file, weights, _ = small
    save_weights(file, weights, {"robot": "ur5e_mobile"})
    with pytest.raises(ValueError, match=r"basenet\.weights: base_pose/.*: (missing|unknown|found)"):
        load_policies(file)
