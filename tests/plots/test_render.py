"""MuJoCo's pictures, in processes of their own: the backend is chosen before MuJoCo is imported."""

import importlib.util
import itertools
import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from basenet_jax.plots import render_plan, save_video
from basenet_jax.task.motion import plan_motion
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
for name in ("video.gif", "video.mp4"):
    video = render_video(robot, *pieces, width=96, height=64, frames_per_s=1.0, speed=3.0)
    save_video(sys.argv[1] + "/" + name, video.frames, video.frames_per_s)
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
    with av.open(str(tmp_path / "video.mp4"), "r") as video:
        film = [frame.to_ndarray(format="rgb24").astype(float) for frame in video.decode(video=0)]
    assert [frame.shape for frame in film] == len(frames) * [(64, 96, 3)]
    assert np.mean(np.abs(np.array(film) - np.array(frames))) < 10, "both show the same, as well as they can"
    motion = plan_motion(robot, scene, plan, judged.made_up_outcome())
    assert len(frames) == int(motion.time[-1] / 3.0) + 1
    changes = [np.abs(after - before).max() for before, after in itertools.pairwise(frames)]
    assert np.mean(np.array(changes) > 20) > 0.8


def test_only_feasible_steps_can_be_drawn(robot, scene, plan, outcome):
    with pytest.raises(ValueError, match=r"step: found 0, feasible are \[1\]"):
        render_plan(robot, scene, plan, judged.with_failure(outcome, 0), step=0)


def frames_of(count):
    """A bright column that wanders over a dark picture."""
    for index in range(count):
        frame = np.full((32, 48, 3), 20, np.uint8)
        frame[:, 4 * index : 4 * index + 4] = 240
        yield frame


@pytest.mark.parametrize("name", ["video.mp4", "video.gif"])
def test_frames_are_taken_one_by_one_and_all_written(tmp_path, name):
    save_video(tmp_path / name, frames_of(12), frames_per_s=10.0)
    with av.open(str(tmp_path / name), "r") as video:
        assert float(video.streams.video[0].average_rate or 0) == pytest.approx(10.0, rel=0.01)
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    brightest = [int(frame.mean(axis=(0, 2)).argmax()) // 4 for frame in frames]
    assert brightest == list(range(12))


def test_a_video_has_a_known_ending_or_is_not_made(tmp_path):
    with pytest.raises(ValueError, match=r"names ending in \.mp4, \.gif"):
        save_video(tmp_path / "video.avi", frames_of(2))
    assert not list(tmp_path.iterdir())


def test_without_pyav_the_message_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r'needs the package av: pip install "basenet_jax\[video\]"'):
        save_video(tmp_path / "video.mp4", frames_of(2))
    save_video(tmp_path / "video.gif", frames_of(2))
    assert [path.name for path in tmp_path.iterdir()] == ["video.gif"]
