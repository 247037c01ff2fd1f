from importlib import resources
from pathlib import Path

import pytest
import yaml

ASSETS = Path(str(resources.files("basenet_jax.robot") / "assets"))


@pytest.fixture
def files(tmp_path):
    """A copy of the UR5e's files to damage: the robot file's content, and where to write it beside the model."""
    content = yaml.safe_load((ASSETS / "ur5e_mobile.yaml").read_text())
    (tmp_path / content["model"]).write_text((ASSETS / content["model"]).read_text())
    return {**content, "name": "mine"}, tmp_path / "robot.yaml"
