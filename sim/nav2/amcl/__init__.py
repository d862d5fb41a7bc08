"""AMCL: particles, their motion, their weights by a scan, and the pose that follows."""
