"""Values that every layer shares: configurations, faults, kinds of number, and the base of all producers."""
