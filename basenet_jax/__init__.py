"""Base-pose sequence planning for mobile manipulators, trained and solved in JAX."""
