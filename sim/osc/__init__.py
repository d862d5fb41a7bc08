"""OpenSCENARIO DSL: a scenario file as text, read and checked into definitions that a behavior tree is built from."""
