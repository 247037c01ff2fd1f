"""How the planners compare."""
