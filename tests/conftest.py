"""What all tests share: examples that are the same at every run."""

from hypothesis import settings

# A change is judged by what it changes, not by the examples of the day; `--hypothesis-profile=default` looks for new ones.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")
