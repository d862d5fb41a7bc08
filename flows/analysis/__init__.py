"""Analysis of campaigns that have ended: comparison of two, and minimization of a failing configuration."""
