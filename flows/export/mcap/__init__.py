"""Runs as bags of ROS 2: topics and types, the messages of a run, the bag, and a layout for Foxglove."""
