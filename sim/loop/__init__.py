"""The closed loop: navigation stack and world in turn, on one clock."""
