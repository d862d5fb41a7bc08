"""Figures: maps with what happened on them, success rates, factors."""
