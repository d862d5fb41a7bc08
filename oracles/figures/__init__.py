"""Figures: maps with what happened on them, rates, factors."""
