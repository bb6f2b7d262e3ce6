"""The whole quadruped: kinematics, gait, walk."""
