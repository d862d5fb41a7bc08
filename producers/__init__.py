"""Inst: the campaign file and the ordered producers that turn it into configurations."""
