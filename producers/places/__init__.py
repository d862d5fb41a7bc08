"""Places and routes: maps, ground, routes, placement."""
