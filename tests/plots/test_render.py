"""MuJoCo's pictures, in processes of their own: the backend is chosen before MuJoCo is imported."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from basenet_jax.plots import render_plan, save_video
from basenet_jax.plots.motion import plan_motion
from tests import judged

ROOT = Path(__file__).parents[2]

PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
mujoco.Renderer(model, 8, 8).close()
"""

DRAW = """
import sys
from PIL import Image
from basenet_jax.plots import RenderError, render_plan, render_video, save_video
from basenet_jax.robot.reading import load_robot
from tests import judged
robot = load_robot()
pieces = judged.first(judged.scenes()), judged.first(judged.plans()), judged.made_up_outcome()
try:
    image = render_plan(robot, *pieces, width=160, height=120)
except RenderError as error:
    sys.exit(f"RenderError: {error}")
Image.fromarray(image).save(sys.argv[1] + "/image.png")
frames = render_video(robot, *pieces, width=96, height=64, frames_per_s=1.0, speed=3.0)
save_video(sys.argv[1] + "/video.gif", frames)
"""


def python(code, backend, *arguments):
    environment = os.environ | {"MUJOCO_GL": backend}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def test_without_a_backend_the_message_says_what_to_do(tmp_path):
    done = python(DRAW, "disable", tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("RenderError: MuJoCo can't draw off screen with MUJOCO_GL=disable")
    assert "MUJOCO_GL=egl" in done.stderr
    assert not list(tmp_path.iterdir())


def test_image_and_video_show_a_moving_robot(tmp_path, robot, scene, plan):
    if python(PROBE, "egl").returncode:
        pytest.skip("no EGL driver here")
    done = python(DRAW, "egl", tmp_path)
    assert done.returncode == 0, done.stderr
    with Image.open(tmp_path / "image.png") as picture:
        image = np.asarray(picture)
    assert image.shape == (120, 160, 3)
    assert image.std() > 10, "something is in the picture"
    with Image.open(tmp_path / "video.gif") as video:
        frames = [np.asarray(frame.convert("RGB"), float) for frame in ImageSequence.Iterator(video)]
    motion = plan_motion(robot, scene, plan, judged.made_up_outcome())
    assert len(frames) == int(motion.time[-1] / 3.0) + 1
    changes = [np.abs(after - before).max() for before, after in itertools.pairwise(frames)]
    assert np.mean(np.array(changes) > 20) > 0.8


def test_only_feasible_steps_can_be_drawn(robot, scene, plan, outcome):
    with pytest.raises(ValueError, match=r"step: found 0, feasible are \[1\]"):
        render_plan(robot, scene, plan, judged.with_failure(outcome, 0), step=0)


def test_a_video_is_a_gif_or_nothing(tmp_path):
    with pytest.raises(ValueError, match=r"names ending in \.gif"):
        save_video(tmp_path / "video.mp4", np.zeros((2, 8, 8, 3), np.uint8))
    assert not list(tmp_path.iterdir())
