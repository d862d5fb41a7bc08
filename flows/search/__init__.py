"""A search under way: its batches, what was found at them, and what is written of it."""
