"""Plans for robots: the same execution as messages of ROS 2, in YAML or a bag, and as a table of states over time."""

from basenet_jax.exports.folder import FORMATS, Export, ExportError, check_export, check_table_pose, export
from basenet_jax.exports.schedule import Schedule, make_schedule

__all__ = [
    "FORMATS",
    "Export",
    "ExportError",
    "Schedule",
    "check_export",
    "check_table_pose",
    "export",
    "make_schedule",
]
