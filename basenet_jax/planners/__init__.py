"""Who plans: the paper's classical planners, exact dynamic programming, and the learned policies."""
