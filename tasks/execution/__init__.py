"""How runs are executed in containers: one description, and what each container engine is given for it."""
