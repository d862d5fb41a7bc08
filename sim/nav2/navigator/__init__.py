"""The navigator: one tick of the whole stack, its state, and the robot's behaviors."""
