"""A minimization under way: the configuration it begins with, the runs of its candidates, the campaign file that is written."""
