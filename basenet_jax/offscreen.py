"""Drawing without a display: the OpenGL backend that MuJoCo has to know before it is imported."""

import os
import subprocess
import sys

BACKENDS = ("egl", "osmesa")

_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
mujoco.Renderer(model, 8, 8).close()
"""


class RenderError(RuntimeError):
    """MuJoCo can't draw here, and what to do about it."""


def choose_backend() -> None:
    """Sets MUJOCO_GL to a backend that can draw here, unless the user has set it; tried in processes of their own.

    Does nothing where MuJoCo is imported already, which is too late, nor on macOS and Windows, where there is one.

    Raises:
        RenderError: there is none, or not the one that was set.
    """
    if "mujoco" in sys.modules or not sys.platform.startswith("linux"):
        return
    chosen = os.environ.get("MUJOCO_GL")
    for backend in (chosen,) if chosen else BACKENDS:
        environment = os.environ | {"MUJOCO_GL": backend}
        if subprocess.run([sys.executable, "-c", _PROBE], env=environment, capture_output=True, check=False).returncode:
            continue
        os.environ["MUJOCO_GL"] = backend
        return
    if chosen:
        raise RenderError(f"MuJoCo can't draw with MUJOCO_GL={chosen}, allowed are egl and osmesa where they work")
    raise RenderError(
        "MuJoCo can't draw here: neither EGL (of a graphics driver) nor OSMesa (software) works; on Debian and Ubuntu "
        "install libegl1 or libosmesa6"
    )
