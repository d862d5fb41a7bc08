"""A minimization under way: the configuration it begins with, its candidates as campaign files, their runs, what is written."""
