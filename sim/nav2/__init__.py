"""The navigation stack in the loop, after Nav2, from its parameters to its navigator."""
