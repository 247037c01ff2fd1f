"""Frames as a video file."""

import importlib.util
import io
import itertools
import os
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from basenet_jax.atomic import write_atomically

SUFFIXES = (".mp4", ".gif")


def check_video(name: str, path: str | os.PathLike[str]) -> None:
    """Whether videos of such a name can be made here.

    Args:
        name: of the argument or option, for the message.
        path: of the file.

    Raises:
        ValueError: they can't.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{name}: found {path}, allowed are names ending in {', '.join(SUFFIXES)}")
    if suffix == ".mp4" and importlib.util.find_spec("av") is None:
        needed = 'needs the package av: pip install "basenet_jax[video]"'
        raise ValueError(f"{name}: found {path}, which {needed}; a name ending in .gif needs nothing")


def save_video(
    path: str | os.PathLike[str],
    frames: Iterable[UInt8[np.ndarray, "height width 3"]],
    frames_per_s: float = 30.0,
) -> None:
    """Writes frames as H.264 in .mp4 or as an animated .gif, by the name's ending; whole or not at all.

    Args:
        path: of the file.
        frames: at least one; taken one after the other, so that they needn't be in memory together. For .mp4 their
            sides are even numbers.
        frames_per_s: of the video; a GIF's are rounded to hundredths of a second each.

    Raises:
        ValueError: the name has another ending, or .mp4 needs a package that isn't installed.
        OSError: it can't be written.
    """
    check_video("path", path)
    write_atomically(path, encode_video(Path(path).suffix.lower(), frames, frames_per_s))


def encode_video(suffix: str, frames: Iterable[UInt8[np.ndarray, "height width 3"]], frames_per_s: float) -> bytes:
    """The content of a video file; `suffix` is .mp4 or .gif, the rest is as for `save_video`."""
    return (_mp4 if suffix == ".mp4" else _gif)(iter(frames), frames_per_s)


def _mp4(frames: Iterator[np.ndarray], frames_per_s: float) -> bytes:
    # PyAV and not imageio-ffmpeg: it is released several times a year with each FFmpeg, and encodes in this process,
    # where the other one pipes frames to a packaged program.
    import av

    stream = io.BytesIO()
    first = next(frames)
    with av.open(stream, "w", format="mp4") as container:
        video = container.add_stream("libx264", rate=Fraction(frames_per_s).limit_denominator(1000))
        video.height, video.width = first.shape[:2]
        video.pix_fmt = "yuv420p"  # what all players know
        for frame in itertools.chain([first], frames):
            container.mux(video.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(video.encode())
    return stream.getvalue()


def _gif(frames: Iterator[np.ndarray], frames_per_s: float) -> bytes:
    first, *rest = (Image.fromarray(frame).quantize() for frame in frames)
    stream = io.BytesIO()
    first.save(stream, "GIF", save_all=True, append_images=rest, duration=1000 / frames_per_s, loop=0)
    return stream.getvalue()
