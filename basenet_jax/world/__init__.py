"""Where the robot works: scenes, their files, clearances, and the MuJoCo scene."""
