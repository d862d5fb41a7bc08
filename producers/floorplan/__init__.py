"""Floor plans: the FloorPlan DSL (`.fpm`) and the Variation DSL (`.variation`), as map, mesh, geometry and picture."""
