"""Obs, Oracle and evidence: recordings to traces, traces to verdicts, verdicts to statistics and a report."""
