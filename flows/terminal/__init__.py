"""What a terminal and a notebook show, and what Ctrl-C does there."""
