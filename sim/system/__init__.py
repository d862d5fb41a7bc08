"""The system under test: what anything may know of a robot and of the software that drives it."""
