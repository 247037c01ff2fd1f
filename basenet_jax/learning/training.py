"""One whole training: the paper's two layers, then the policy over candidate stops."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax

from basenet_jax.devices import ONE_DEVICE, Devices
from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.learning.config import TrainConfig
from basenet_jax.learning.reinforce import Reinforce, sequence_network
from basenet_jax.learning.run_directory import RunDirectory
from basenet_jax.learning.sac import Sac
from basenet_jax.learning.stop_learning import StopLearning, stop_network
from basenet_jax.learning.training_loop import run_intervals
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.networks import BasePoseNetwork, Networks, SequenceNetwork, StopNetwork
from basenet_jax.policies.trained import Weights, untrained_sequence, untrained_stops
from basenet_jax.progress import Reporter
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.weights_file import load_weights, save_weights

Layer = Literal["base-pose", "sequence", "stops", "all"]

BASE_POSE_WEIGHTS, SEQUENCE_WEIGHTS, STOP_WEIGHTS = "base_pose.weights", "sequence.weights", "stops.weights"
WEIGHTS = "basenet.weights"  # all of them


class Trained(NamedTuple):
    """The layers trained so far; None for others."""

    base_pose: BasePosePolicy | None
    sequence: Any
    stops: Any


class Training:
    """One training: its configuration, and the learners made from it."""

    def __init__(self, config: TrainConfig, robot: Robot | None = None, devices: Devices = ONE_DEVICE):
        """Compiles nothing yet.

        Args:
            config: of everything.
            robot: one that isn't packaged; by default the packaged one that the configuration names.
            devices: that share the work; the results are one device's up to rounding.

        Raises:
            ValueError: a batch can't be shared out to the devices.
        """
        self.config, self.devices = config, devices
        for layer in (config.sac, config.reinforce, config.stops):
            devices.check(layer.batches)  # now, not after an hour of the layers before
        self.robot: Robot = jax.device_put(load_robot(config.robot) if robot is None else robot)
        self.base_pose_key, self.sequence_key, self.stops_key = jax.random.split(jax.random.key(config.seed), 3)
        env = BasePoseEnv(
            self.robot,
            frame=config.sac.frame,
            own_class_share=config.sac.own_class_share,
            reward=config.sac.reward,
            world=config.world,
        )
        self.sac = Sac(env, config.sac, devices)

    def reinforce(self, base_pose: BasePosePolicy) -> Reinforce:
        """The sequence learner for a frozen base-pose policy."""
        return Reinforce(self.robot, base_pose, self.config.reinforce, self.config.world, self.devices)

    @staticmethod
    def check(run_path: Path, layer: Layer) -> None:
        """Whether a layer can be trained in a run directory, before that is made.

        Raises:
            ValueError: base-pose weights are needed and there are none.
        """
        if layer == "sequence" and not (run_path / "weights" / BASE_POSE_WEIGHTS).exists():
            file = run_path / "weights" / BASE_POSE_WEIGHTS
            raise ValueError(
                f"{file}: found no such file, which --layer sequence needs; train --layer base-pose there first"
            )

    def train(self, run: RunDirectory, reporter: Reporter, *, layer: Layer = "all", resume: bool = False) -> Trained:
        """Trains the layers asked for, and writes their weights into the run directory.

        With `layer="sequence"` the base-pose weights of the run directory are used. Once all layers are there, alone
        or together, they are also written as one file for the planners.

        Returns:
            The layers that were trained now or before.

        Raises:
            ValueError: base-pose weights are needed and there are none.
            CheckpointError, Interrupted, TrainingDiverged: see `run_intervals`.
        """
        base_pose = self._kept(run, BASE_POSE_WEIGHTS, self._untrained_base_pose, needed=layer == "sequence")
        sequence = self._kept(
            run, SEQUENCE_WEIGHTS, lambda: untrained_sequence(sequence_network(self.config.reinforce))
        )
        stops = self._kept(run, STOP_WEIGHTS, lambda: untrained_stops(stop_network(self.config.stops)))
        if base_pose is None and layer in ("base-pose", "all"):
            base_pose = self._train_base_pose(run, reporter, resume)
        if sequence is None and layer in ("sequence", "all"):
            sequence = self._train_sequence(run, reporter, resume, base_pose)
        if stops is None and layer in ("stops", "all"):
            stops = self._train_stops(run, reporter, resume)
        if base_pose is not None and sequence is not None and stops is not None:
            save_weights(run.weights / WEIGHTS, Weights(base_pose, sequence, stops), self._metadata())
        return Trained(base_pose, sequence, stops)

    def _train_base_pose(self, run: RunDirectory, reporter: Reporter, resume: bool) -> BasePosePolicy:
        config = self.config.sac
        state = _run(
            "base-pose",
            self.sac,
            self.base_pose_key,
            run,
            reporter,
            resume,
            work=config.iterations_per_interval * config.episodes_per_iteration,
            figures=("success", "collision", "navigation_time", "pick_time"),
        )
        return self._keep(run, BASE_POSE_WEIGHTS, self.sac.policy(state))

    def _train_sequence(
        self, run: RunDirectory, reporter: Reporter, resume: bool, base_pose: BasePosePolicy | None
    ) -> Any:
        assert base_pose is not None  # it was trained before, or is needed and kept
        config = self.config.reinforce
        state = _run(
            "sequence",
            self.reinforce(base_pose),
            self.sequence_key,
            run,
            reporter,
            resume,
            work=config.updates_per_interval * config.episodes_per_update,
            figures=("navigation_time", "nearest_navigation_time", "driven_to"),
        )
        return self._keep(run, SEQUENCE_WEIGHTS, state.params)

    def _train_stops(self, run: RunDirectory, reporter: Reporter, resume: bool) -> Any:
        config = self.config.stops
        reporter.note("stops: a library of picks and searched plans comes first")
        state = _run(
            "stops",
            StopLearning(self.robot, config, self.config.world, devices=self.devices),
            self.stops_key,
            run,
            reporter,
            resume,
            unit="examples",
            work=config.updates_per_interval * config.imitations_per_update,
            figures=("execution_time", "ratio_to_rule", "loss"),
        )
        return self._keep(run, STOP_WEIGHTS, state.params)

    def _untrained_base_pose(self) -> BasePosePolicy:
        return self.sac.policy(self.sac.init(jax.random.key(0)))

    def _keep(self, run: RunDirectory, name: str, weights: Any) -> Any:
        save_weights(run.weights / name, weights, self._metadata() | {"config": run.config_hash})
        return weights

    def _kept(self, run: RunDirectory, name: str, like: Callable[[], Any], *, needed: bool = False) -> Any:
        """A layer's weights that an earlier training of the run directory left; None if it left none.

        Raises:
            ValueError: they can't be read, or are needed and missing, or were made with another configuration.
        """
        file = run.weights / name
        if not needed and not file.exists():
            return None
        weights, metadata = load_weights(file, jax.eval_shape(like))
        if metadata.get("config") != run.config_hash:
            raise ValueError(f"{file}: made with another configuration than this run's")
        return weights

    def _metadata(self) -> dict[str, Any]:
        config = self.config
        networks = Networks(
            BasePoseNetwork(config.sac.frame, config.sac.hidden),
            SequenceNetwork.of(sequence_network(config.reinforce)),
            StopNetwork.of(stop_network(config.stops)),
        )
        return {
            "preset": config.preset,
            "seed": config.seed,
            "objects": config.reinforce.objects,
            "robot": config.robot,
        } | networks.as_metadata()


def _run(
    name: str,
    learner: Any,
    key: jax.Array,
    run: RunDirectory,
    reporter: Reporter,
    resume: bool,
    *,
    work: float,
    figures: Sequence[str],
    unit: str = "episodes",
) -> Any:
    """The last state of a learner: it has a `config` with `intervals`, and `init` and `interval` to be jitted."""
    return run_intervals(
        name=name,
        init=learner.init,
        interval=jax.jit(learner.interval, donate_argnums=0),
        intervals=learner.config.intervals,
        run=run,
        reporter=reporter,
        key=key,
        resume=resume,
        unit=unit,
        work=work,
        figures=figures,
    )
