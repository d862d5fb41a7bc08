"""The navigator: one tick of the whole stack, its state, and what the robot does next."""
