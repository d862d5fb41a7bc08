"""Obs, Oracle and evidence: recordings to traces, traces to verdicts, verdicts to statistics and a report."""

if __name__ != "vastflow.oracles":
    raise ImportError(f"import vastflow.oracles, not {__name__}: one module has one name")
