"""Exec: one scenario and one seed to one run's recording."""

if __name__ != "vastflow.sim":
    raise ImportError(f"import vastflow.sim, not {__name__}: one module has one name")
