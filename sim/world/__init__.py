"""The world of one run: maps, walls, obstacles, the robot's body, and its lidar with its noise."""
