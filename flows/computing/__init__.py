"""Prefect's side of a campaign on this machine: the flow, its task runs, what its pages show."""
