"""OpenSCENARIO DSL: a scenario file as text, read and checked into definitions that a behaviour tree is built from."""
