"""The world of one run: walls, obstacles, the robot's body, and its lidar."""
