"""`python -m tests.tiny_training ARGUMENTS`: the train command with every size made tiny, for the tests of it."""

import sys

from basenet_jax import train
from basenet_jax.learning import config
from basenet_jax.learning.config import ReinforceConfig, SacConfig, StopLearningConfig, TrainConfig


def tiny_preset(preset, *, objects, seed, robot="ur5e_mobile", robot_digest=None):
    sac = SacConfig(
        hidden=(32, 32),
        episodes_per_iteration=64,
        updates_per_iteration=4,
        batch_size=64,
        replay_size=512,
        iterations_per_interval=3,
        intervals=4,
        evaluation_problems=64,
    )
    reinforce = ReinforceConfig(
        objects=objects,
        features=8,
        layers=2,
        episodes_per_update=8,
        updates_per_interval=2,
        intervals=4,
        test_episodes=16,
        evaluation_scenes=8,
    )
    stops = StopLearningConfig(
        objects=objects,
        features=8,
        layers=1,
        library_objects=32,
        examples=16,
        search_iterations=10,
        imitation_intervals=2,
        imitations_per_update=8,
        problems_per_update=4,
        samples=2,
        updates_per_interval=2,
        intervals=4,
        evaluation_problems=8,
    )
    return TrainConfig(
        preset=preset,
        seed=seed,
        robot=robot,
        robot_digest=robot_digest,
        sac=sac,
        reinforce=reinforce,
        stops=stops,
        evaluation_objects=(2,),
        evaluation_scenes=4,
    )


def main(arguments):
    usual, config.make_preset = config.make_preset, tiny_preset
    try:
        return train.main(arguments)
    finally:
        config.make_preset = usual  # other tests may run in this process


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
