"""What the learners use of Brax, imported without its chatter.

Importing Brax imports MJX, which reports on stdout that the optional package warp is missing, and JAXopt, which warns
that nobody maintains it: no part of Brax that is used here uses it.
"""

import contextlib
import io
import warnings

with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
    warnings.filterwarnings("ignore", "JAXopt is no longer maintained", DeprecationWarning)
    from brax.envs.base import Env, State
    from brax.training import gradients, replay_buffers
    from brax.training.acme import running_statistics, specs
    from brax.training.agents.sac import losses, networks

__all__ = [
    "Env",
    "State",
    "gradients",
    "losses",
    "networks",
    "replay_buffers",
    "running_statistics",
    "specs",
]
