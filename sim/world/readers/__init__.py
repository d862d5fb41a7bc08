"""Readers of world files: from a file to the bodies in it."""
