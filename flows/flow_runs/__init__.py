"""Flow runs of Prefect: how a flow is called, the stages as task runs, what Prefect's pages show."""
