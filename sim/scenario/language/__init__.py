"""OpenSCENARIO DSL: a scenario file as text, read and checked into a definition."""
