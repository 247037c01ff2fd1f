"""The learned policies: where to park for a grasp, and what to grasp next."""
