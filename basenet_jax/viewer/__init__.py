"""The live page of `python -m basenet_jax.view`: what it knows and does (no viser), and how viser shows it."""
