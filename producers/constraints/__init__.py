"""Constraints between the values of a configuration: their language, their quantities, how they are read."""
