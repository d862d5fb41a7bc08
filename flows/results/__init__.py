"""The campaign directory: its content, how it is written, and its provenance."""
