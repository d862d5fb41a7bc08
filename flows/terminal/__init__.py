"""What a terminal shows, and what Ctrl-C does there."""
