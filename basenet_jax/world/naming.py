"""Names for the objects of drawn scenes."""

from collections import Counter

import numpy as np

from basenet_jax.world.scene import OBJECT_CLASSES, NamedScene, Scene


def name_objects(arrays: Scene, robot: str = "ur5e_mobile") -> NamedScene:
    """An unbatched scene with its objects named by class and number, such as `mug_1`, `mug_2`, `object_1`."""
    counts: Counter[str] = Counter()
    names = []
    for index in np.asarray(arrays.object_class)[np.asarray(arrays.mask)]:
        kind = OBJECT_CLASSES[index].name if index >= 0 else "object"
        counts[kind] += 1
        names.append(f"{kind}_{counts[kind]}")
    return NamedScene(arrays, tuple(names), robot)
