"""What all tests share: examples that are the same at every run, and that may take as long as a busy machine needs."""

from hypothesis import settings

# A change is judged by what it changes, not by the examples of the day; `--hypothesis-profile=other` looks for new ones, and
# `--hypothesis-seed=N` with it for those of a seed. Deadlines are of wall time: they fail on a machine that others use.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("other", deadline=None)
settings.load_profile("same")
