"""Durations of trapezoidal velocity profiles."""

import math

JOINT_SPEED = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)  # rad/s
JOINT_ACCELERATION = 1.4  # rad/s^2


def trapezoid(distance, speed, acceleration):
    """Duration (s) from rest to rest: with a cruise if the top speed is reached, else two equal ramps."""
    distance = abs(distance)
    ramps = speed * speed / acceleration  # covered while accelerating to the top speed and braking again
    if distance < ramps:
        return 2.0 * math.sqrt(distance / acceleration)
    return 2.0 * speed / acceleration + (distance - ramps) / speed


def joint_move(start, goal):
    """Duration (s) of a joint move in which all joints arrive with the slowest."""
    durations = [
        trapezoid(b - a, speed, JOINT_ACCELERATION) for a, b, speed in zip(start, goal, JOINT_SPEED, strict=True)
    ]
    return max(durations)


def wrap(angle):
    """The angle in (-pi, pi]."""
    angle = math.fmod(angle, 2 * math.pi)
    if angle > math.pi:
        return angle - 2 * math.pi
    return angle + 2 * math.pi if angle <= -math.pi else angle
