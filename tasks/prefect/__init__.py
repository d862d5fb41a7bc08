"""Prefect: its API, logs, flow runs, deployments, and the stages as its tasks."""
