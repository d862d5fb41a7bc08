"""Occupancy maps as the simulator has them: cells, their frame, and lengths on the grid."""
