"""Planners that search: Nav2's SmacPlanner2D and SmacPlannerHybrid."""
