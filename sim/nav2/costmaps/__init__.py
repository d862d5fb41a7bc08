"""Costmaps: layers, filters, inflation, and the footprint on them."""
