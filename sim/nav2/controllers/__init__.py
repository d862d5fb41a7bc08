"""Controllers: from the path and the local costmap to a velocity command."""
