"""A campaign directory as a folder for each run, and as JUnit reports."""
