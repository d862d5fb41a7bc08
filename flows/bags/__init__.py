"""Bags of ROS: read as arrays, imported as recorded runs, and compared with the simulator."""
