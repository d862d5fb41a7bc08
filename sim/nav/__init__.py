"""The navigation stack in the loop, after Nav2: localization, costmaps, planner, controller, behavior."""
