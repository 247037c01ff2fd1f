"""How fast the package is, and what its learned order of grasps is worth; every figure with how to get it again."""
