"""Steps that a campaign file names for its results: run over a copy of them, each in a process of its own."""
