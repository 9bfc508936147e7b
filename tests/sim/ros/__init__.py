"""The twin and drivers over topics of ROS 2."""
