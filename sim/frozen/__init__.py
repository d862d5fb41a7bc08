"""Plug-ins as they were when keys were made: what one uses, copies of it, and what runs from the copies."""
