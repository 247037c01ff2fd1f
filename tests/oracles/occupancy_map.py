"""Cells of ROS maps, one by one, as nav2_map_server's `map_io.cpp` computes them; and what rectangles cover."""

from math import cos, sin

FREE, OCCUPIED, UNKNOWN = 0, 100, -1


def cell_value(red, green, blue, alpha, *, mode, negate, occupied_thresh, free_thresh):
    """What map_server publishes for a pixel of 8 bits a channel; `alpha` None: the image has no such channel."""
    channels = [red, green, blue]
    if mode == "trinary" and alpha is not None:
        channels.append(alpha)
    shade = sum(channels) / len(channels) / 255
    occupancy = shade if negate else 1 - shade
    if mode == "raw":
        percent = round(shade * 255)
        return percent if percent <= 100 else UNKNOWN
    if mode == "scale" and alpha is not None and alpha < 255:
        return UNKNOWN
    if occupancy > occupied_thresh:
        return OCCUPIED
    if occupancy < free_thresh:
        return FREE
    if mode == "trinary":
        return UNKNOWN
    return max(1, round(100 * (occupancy - free_thresh) / (occupied_thresh - free_thresh)))  # a grade of grey


def inside_box(point, pose, half_size):
    """Whether a point in W lies in a box turned about z."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    along, across = cos(pose[2]) * dx + sin(pose[2]) * dy, cos(pose[2]) * dy - sin(pose[2]) * dx
    return abs(along) <= half_size[0] and abs(across) <= half_size[1]
