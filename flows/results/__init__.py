"""The campaign directory: what it holds, how it is written, what it is remembered by."""
