"""What the robot can do: its model, kinematics, inverse kinematics and timing."""
