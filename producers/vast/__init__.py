"""The campaign file as text: its sections, their models, and faults with their places."""
