"""Prefect tasks round the pure stages: digests, store, worker pool, progress. No arithmetic."""
