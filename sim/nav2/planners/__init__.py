"""Planners: NavFn, SmacPlanner2D, and SmacPlannerHybrid."""
