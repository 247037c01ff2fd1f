"""`python -m basenet_jax.robot`: the door to `basenet_jax.commands.robot`."""

import sys

from basenet_jax.commands.robot import main

if __name__ == "__main__":
    sys.exit(main())
