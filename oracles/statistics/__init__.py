"""Statistics of pass counts: intervals, classes, effects, failure maps, sample sizes, and comparisons."""
