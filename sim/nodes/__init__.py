"""Nodes of ROS 2 as the system under test: the bridge, and the closed loop that they drive."""
