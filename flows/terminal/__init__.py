"""The display in a terminal and in a notebook, options of commands, and their ends."""
