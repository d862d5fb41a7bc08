"""Inst: the campaign file and the ordered producers that turn it into configurations."""

if __name__ != "vastflow.producers":
    raise ImportError(f"import vastflow.producers, not {__name__}: one module has one name")
