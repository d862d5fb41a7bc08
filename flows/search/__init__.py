"""A search: its batches, what was found at them, and what is written of it."""
