"""The closed loop: navigation stack, world, scenario and programs in turn, on one clock."""
