"""Kinematics, trajectories, grasp poses, the CAN gripper and the skills built on them."""
