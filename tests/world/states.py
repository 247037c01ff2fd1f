"""Random states of the robot around the table, and pairs of states on either side of touching."""

import numpy as np

DOF = 6
# Rule 1 takes a clearance up to this for touching (m).
TOUCHING = 1e-5
# float32 knows positions within 3 m to 2e-7 m, and a touch is decided after some ten operations on them.
ROUNDING = 5e-6


def random_states(rng, count):
    """Base poses (N, 3) within 2 m x 1.5 m of the table's centre and joints (N, 6) over one turn each."""
    pose = rng.uniform([-2.0, -1.5, -np.pi], [2.0, 1.5, np.pi], size=(count, 3))
    return np.concatenate([pose, rng.uniform(-np.pi, np.pi, size=(count, DOF))], axis=1)


def around_touching(touches, states, count, apart):
    """Two arrays of states on straight lines from a touching to a free state: `apart` before and behind the change.

    Bisection in float64: after 45 halvings of a few radians the change is known to 1e-13.
    """
    hit = touches(states)
    inner, outer = states[hit][:count], states[~hit][:count]
    step = apart * (outer - inner) / np.linalg.norm(outer - inner, axis=1, keepdims=True)
    for _ in range(45):
        middle = 0.5 * (inner + outer)
        inside = touches(middle)[:, None]
        inner, outer = np.where(inside, middle, inner), np.where(inside, outer, middle)
    return inner - step, outer + step


def doubtful(distance, threshold):
    """Where float32's rounding may decide."""
    return np.abs(distance - threshold) <= ROUNDING
