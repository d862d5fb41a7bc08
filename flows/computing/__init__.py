"""Prefect's side of a campaign on this machine: the stages as task runs, how a flow is called, what its pages show."""
