"""The campaign file as text: its sections, their models, the files that it names, and faults with their places."""
