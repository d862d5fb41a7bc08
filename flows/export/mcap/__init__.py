"""Runs as bags of ROS 2: topics, messages, the bag, and a layout for Foxglove."""
