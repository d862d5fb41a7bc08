"""Observation: from the recording of a run to its trace, in the situation that the scenario gives."""
