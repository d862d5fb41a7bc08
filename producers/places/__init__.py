"""Where things can stand and how one gets there: maps, ground, routes, placement."""
