"""Search: strategies that choose the next points of a space by earlier results."""
