"""Prefect: its API, its logs, its flow runs, and the stages as its tasks."""
