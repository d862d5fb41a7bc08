"""Prefect tasks round the pure stages: digests, store, executors, progress. No arithmetic."""

if __name__ != "vastflow.tasks":
    raise ImportError(f"import vastflow.tasks, not {__name__}: one module has one name")
